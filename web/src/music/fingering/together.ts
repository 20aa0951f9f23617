/** Notes that are struck together. */

import type { Note } from "../../types";

/** Notes struck within this time of the first, in s, are one chord. */
export const TOGETHER = 0.03;

/**
 * A key that is let go within this time, in s, after the next is struck counts as let go before.
 *
 * Legato is played with a little overlap.
 */
export const OVERLAP = 0.05;

/** Return the indices of the notes of each chord; `notes` are sorted by onset. */
export function struckTogether(notes: readonly Note[]): number[][] {
  const chords: number[][] = [];
  notes.forEach((note, index) => {
    const last = chords.at(-1);
    if (last && note.onset <= notes[last[0]!]!.onset + TOGETHER) last.push(index);
    else chords.push([index]);
  });
  return chords;
}
