import type { Stretch, View } from "./cameras";
import type { RollNote } from "./roll_notes";

/** The whole keyboard. */
export const ALL_KEYS: Stretch = { middle: 0, width: 1.22 };

/** Views that go along with the music; the others have the keys of the whole piece in sight. */
const FOLLOWING: readonly View[] = ["close"];
/** What these have in sight of it, s before and after now, and the least widths, m; as in Python's `note_bars`. */
const PAST = 1;
const COMING = 2;
const LEAST_FOLLOWED = 0.25;
const LEAST_STRETCH = 0.5;

/** The parts of the keyboard that a piece needs, as a whole and around any time. */
export class Stretches {
  private readonly whole: Stretch;

  /** @param keyY (88) places of the keys along the keyboard, m. */
  constructor(
    private readonly notes: readonly RollNote[],
    private readonly keyY: readonly number[],
    private readonly timestep: number,
  ) {
    this.whole = this.around(notes, LEAST_STRETCH) ?? ALL_KEYS;
  }

  /** What a view has to have in sight at a time, s. */
  at(view: View, time: number): Stretch {
    if (!FOLLOWING.includes(view)) return this.whole;
    const from = (time - PAST) / this.timestep;
    const to = (time + COMING) / this.timestep;
    const near = this.notes.filter((note) => note.first < to && note.end > from);
    return this.around(near, LEAST_FOLLOWED) ?? this.whole;
  }

  private around(notes: readonly RollNote[], least: number): Stretch | null {
    if (notes.length === 0) return null;
    const places = notes.map((note) => this.keyY[note.key]);
    const [low, high] = [Math.min(...places), Math.max(...places)];
    return { middle: (low + high) / 2, width: Math.max(high - low, least) };
  }
}
