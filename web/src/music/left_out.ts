/** Notes that are left out while a file is read, in words. */

import { MIN_PITCH } from "../types";
import { MAX_PITCH, pitchName } from "./constants";

const MOST_NAMED = 3;
const KINDS = ["without length", "off the keyboard"] as const;

interface Located {
  /** s. */
  readonly time: number;
  readonly pitch: number;
}

export class LeftOut {
  private readonly notes = { "without length": [] as Located[], "off the keyboard": [] as Located[] };

  /** Take note of a note that ends when it starts, at a time in s. */
  addEmpty(time: number, pitch: number): void {
    this.notes["without length"].push({ time, pitch });
  }

  /** Return whether a piano has the key and the note a length; take note of it if not. */
  isPlayable(onset: number, offset: number, pitch: number): boolean {
    if (pitch < MIN_PITCH || pitch > MAX_PITCH) {
      this.notes["off the keyboard"].push({ time: onset, pitch });
    } else if (!(offset > onset)) {
      this.addEmpty(onset, pitch);
    } else {
      return true;
    }
    return false;
  }

  /** Return "2 notes without length (D4 at 1 s, E4 at 2 s)", empty if there are none. */
  toString(): string {
    return KINDS.filter((kind) => this.notes[kind].length > 0)
      .map((kind) => {
        const notes = this.notes[kind];
        return `${notes.length} note${notes.length > 1 ? "s" : ""} ${kind} (${firstOf(notes)})`;
      })
      .join(" and ");
  }
}

function firstOf(notes: readonly Located[]): string {
  const sorted = [...notes].sort((a, b) => a.time - b.time || a.pitch - b.pitch);
  const named = sorted.slice(0, MOST_NAMED).map(({ time, pitch }) => {
    return `${pitchName(pitch)} at ${Number(time.toPrecision(6))} s`;
  });
  return named.join(", ") + (notes.length > MOST_NAMED ? ", ..." : "");
}
