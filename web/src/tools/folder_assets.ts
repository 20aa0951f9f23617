import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { join } from "node:path";

import type { Assets } from "../types";

/** Files of a folder that `sb3-piano export web` wrote, for node; MuJoCo comes from its package. */
export class FolderAssets implements Assets {
  constructor(private readonly folder: string) {}

  async bytes(name: string): Promise<Uint8Array> {
    const path =
      name === "mujoco.wasm"
        ? createRequire(import.meta.url).resolve("@mujoco/mujoco/mujoco.wasm")
        : join(this.folder, name);
    return new Uint8Array(await readFile(path));
  }

  async json<T>(name: string): Promise<T> {
    return JSON.parse(new TextDecoder().decode(await this.bytes(name))) as T;
  }
}
