import type { PlayerId } from "../types";
import { VIEWS, type View } from "../view/cameras";
import type { OwnFile } from "./library";
import { PLAYER_IDS } from "./players";

/** What a permalink tells: `#piece=...&player=...&tempo=...&view=...`, each of them optional; in place of a piece, `name=...&file=...`. */
export interface Link {
  readonly piece?: string;
  readonly file?: OwnFile;
  readonly player?: PlayerId;
  readonly tempo?: number;
  readonly view?: View;
}

/** Slowest and fastest playback. */
export const TEMPO_RANGE = { min: 0.25, max: 2 } as const;

/** Read a permalink; what makes no sense is left out. */
export function readLink(hash: string): Link {
  const values = new URLSearchParams(hash.replace(/^#/, ""));
  const packed = values.get("file");
  const tempo = Number(values.get("tempo") ?? NaN);
  const fits = tempo >= TEMPO_RANGE.min && tempo <= TEMPO_RANGE.max;
  return {
    piece: values.get("piece") ?? undefined,
    file: packed === null ? undefined : { name: values.get("name") ?? "file", packed },
    player: PLAYER_IDS.find((id) => id === values.get("player")),
    tempo: fits ? tempo : undefined,
    view: VIEWS.find((view) => view === values.get("view")),
  };
}

/** Write a permalink, without what is as it is by default. */
export function writeLink(link: Link): string {
  const values = new URLSearchParams();
  if (link.piece !== undefined) values.set("piece", link.piece);
  if (link.player !== undefined) values.set("player", link.player);
  if (link.tempo !== undefined && link.tempo !== 1) values.set("tempo", String(link.tempo));
  if (link.view !== undefined && link.view !== "stage") values.set("view", link.view);
  if (typeof link.file?.packed === "string") {
    values.set("name", link.file.name);
    values.set("file", link.file.packed);
  }
  return `#${values}`;
}
