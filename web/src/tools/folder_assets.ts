import { readFile } from "node:fs/promises";
import { join } from "node:path";

import type { Assets } from "../types";

/** From the folder web/, where tools are started. */
const MUJOCO = "node_modules/@mujoco/mujoco/mujoco.wasm";

/** Files of a folder that `sb3-piano export web` wrote, for node; MuJoCo comes from its package. */
export class FolderAssets implements Assets {
  constructor(private readonly folder: string) {}

  async bytes(name: string): Promise<Uint8Array> {
    return new Uint8Array(await readFile(name === "mujoco.wasm" ? MUJOCO : join(this.folder, name)));
  }

  async json<T>(name: string): Promise<T> {
    return JSON.parse(new TextDecoder().decode(await this.bytes(name))) as T;
  }
}
