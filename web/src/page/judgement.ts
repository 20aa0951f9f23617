import { NUM_KEYS, type KeyEvent, type PianoRoll } from "../types";
import type { Fate, RollPress } from "../view/roll";
import { notesOf, type RollNote } from "../view/roll_notes";

/** Distance from its onset within which a strike hits a note, s, and ticks to which it is rounded, as in Python. */
const ONSET_TOLERANCE = 0.05;
const TICKS_PER_S = 10_000;

interface Press {
  readonly key: number;
  readonly onset: number;
  offset: number | null;
}

/** What became of each note and each press so far; for the eye, the figures come from the metrics. */
export class Judgement {
  readonly notes: readonly RollNote[];
  private readonly pressesOfKey: Press[][] = Array.from({ length: NUM_KEYS }, () => []);
  private readonly notesOfKey: number[][] = Array.from({ length: NUM_KEYS }, () => []);
  private readonly fateOf: Fate[];

  constructor(private readonly roll: PianoRoll) {
    this.notes = notesOf(roll);
    this.notes.forEach((note, i) => this.notesOfKey[note.key].push(i));
    this.fateOf = this.notes.map(() => "due");
  }

  /** Take up keys that moved. */
  add(events: readonly KeyEvent[]): void {
    for (const { key, down, time } of events) {
      const presses = this.pressesOfKey[key];
      const last = presses.at(-1);
      if (down) presses.push({ key, onset: time, offset: null });
      else if (last !== undefined && last.offset === null) last.offset = time;
    }
  }

  /** One for each note, as of a time, s. */
  fates(time: number): readonly Fate[] {
    for (let key = 0; key < NUM_KEYS; key++) {
      if (this.notesOfKey[key].length > 0) this.judgeKey(key, time);
    }
    return this.fateOf;
  }

  /** All presses so far, as of a time, s. */
  presses(time: number): RollPress[] {
    return this.pressesOfKey.flat().map((press) => ({ ...press, wrong: !this.overlapsDue(press, time) }));
  }

  /**
   * Pair the notes of a key with its strikes in order of time. As all tolerances are equal, taking the earliest
   * strike that fits makes as many pairs as there can be.
   */
  private judgeKey(key: number, time: number): void {
    const presses = this.pressesOfKey[key];
    let next = 0;
    for (const i of this.notesOfKey[key]) {
      const note = this.notes[i];
      const onset = this.roll.strikes[i].time;
      while (next < presses.length && isBefore(presses[next].onset, onset)) next++;
      if (next < presses.length && !isBefore(onset, presses[next].onset)) {
        this.fateOf[i] = "hit";
        next++;
      } else {
        this.fateOf[i] = this.unpaired(note, onset, time);
      }
    }
  }

  private unpaired(note: RollNote, onset: number, time: number): Fate {
    if (time <= onset + ONSET_TOLERANCE) return "due";
    const start = note.first * this.roll.controlTimestep;
    const end = note.end * this.roll.controlTimestep;
    const own = this.pressesOfKey[note.key].some(
      (press) => press.onset < end && (press.offset === null || press.offset > start),
    );
    return own ? "mistimed" : "missed";
  }

  private overlapsDue(press: Press, time: number): boolean {
    const { controlTimestep, steps, active } = this.roll;
    // A key counts in a control step if it sounds at its end.
    const first = Math.floor(press.onset / controlTimestep);
    const last = Math.max(first, Math.floor((press.offset ?? time) / controlTimestep - 1e-6));
    for (let step = first; step <= Math.min(last, steps - 1); step++) {
      if (active[step * NUM_KEYS + press.key] === 1) return true;
    }
    return false;
  }
}

/** Whether a time is too long before another one to hit it. */
function isBefore(time: number, other: number): boolean {
  return Math.round((other - time) * TICKS_PER_S) > ONSET_TOLERANCE * TICKS_PER_S;
}
