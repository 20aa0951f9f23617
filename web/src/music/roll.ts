/** The piano roll: a score cut into control steps. */

import { InputError, NUM_KEYS, MIN_PITCH, UNKNOWN_FINGER } from "../types";
import type { PianoRoll, Score, Strike } from "../types";
import { roundHalfEven, roundTo } from "./numbers";

/** Longest grid, in control steps; longer ones are broken files. */
const MAX_STEPS = 1_000_000;
/** Decimals kept of a time in steps: 0.15 s / 0.05 s is 2.9999999999999996, meant as 3. */
const DECIMALS = 6;

/**
 * Cut a score into control steps, by the rules of Python's `PianoRoll.from_score`.
 *
 * @param controlTimestep length of a control step, s.
 * @param initialBufferTime silence put in front, s; rounded to whole steps.
 * @throws InputError if the roll would have more than a million steps.
 */
export function rollOf(score: Score, controlTimestep: number, initialBufferTime = 0): PianoRoll {
  const lead = roundHalfEven(initialBufferTime / controlTimestep);
  if (!(lead + score.duration / controlTimestep < MAX_STEPS)) {
    throw new InputError(
      `“${score.title}” lasts ${score.duration.toFixed(0)} s, too long for control steps of ` +
        `${controlTimestep} s: expected fewer than ${MAX_STEPS} steps.`,
    );
  }
  const steps = lead + floorSteps(score.duration, controlTimestep) + 1;
  const sheet = new Sheet(steps);
  const due = new Map<number, number>();
  for (const note of score.notes) {
    const key = note.pitch - MIN_PITCH;
    const start = lead + floorSteps(note.onset, controlTimestep);
    const end = lead + ceilSteps(note.offset, controlTimestep);
    const first = sheet.lay(key, start, Math.max(end, start + 1), note.finger);
    const at = first * NUM_KEYS + key;
    // Of two strikes in one step the first one counts.
    if (first >= 0 && !due.has(at)) {
      due.set(at, Math.max(lead * controlTimestep + note.onset, first * controlTimestep));
    }
  }
  return {
    controlTimestep,
    steps,
    active: sheet.active,
    finger: sheet.finger,
    onset: sheet.onset,
    sustain: sustainOf(score, controlTimestep, lead, steps),
    strikes: strikesOf(sheet.onset, due),
  };
}

/** Return the control step in which a time (s) lies. */
export function floorSteps(time: number, controlTimestep: number): number {
  return Math.floor(inSteps(time, controlTimestep));
}

function ceilSteps(time: number, controlTimestep: number): number {
  return Math.ceil(inSteps(time, controlTimestep));
}

function inSteps(time: number, controlTimestep: number): number {
  return Math.min(roundTo(time / controlTimestep, DECIMALS), MAX_STEPS);
}

function sustainOf(score: Score, timestep: number, lead: number, steps: number): Uint8Array {
  const sustain = new Uint8Array(steps);
  for (const { onset, offset } of score.pedals) {
    sustain.fill(1, lead + floorSteps(onset, timestep), lead + floorSteps(offset, timestep));
  }
  return sustain;
}

function strikesOf(onset: Uint8Array, due: ReadonlyMap<number, number>): Strike[] {
  const strikes: Strike[] = [];
  onset.forEach((struck, at) => {
    if (!struck) return;
    strikes.push({ step: Math.floor(at / NUM_KEYS), key: at % NUM_KEYS, time: due.get(at)! });
  });
  return strikes;
}

/** The arrays of a roll while its notes are laid, in order of onset. */
class Sheet {
  readonly active: Uint8Array;
  readonly finger: Int8Array;
  readonly onset: Uint8Array;
  private readonly lastOnset = new Int32Array(NUM_KEYS).fill(-1);

  constructor(steps: number) {
    this.active = new Uint8Array(steps * NUM_KEYS);
    this.finger = new Int8Array(steps * NUM_KEYS).fill(UNKNOWN_FINGER);
    this.onset = new Uint8Array(steps * NUM_KEYS);
  }

  /**
   * Let a key sound from step `start` until before `end`, as a strike of its own if it can.
   *
   * @returns the first step of the strike, or -1 if the note is none of its own.
   */
  lay(key: number, start: number, end: number, finger: number): number {
    const last = this.lastOnset[key]!;
    let first = start;
    let strikes = true;
    let silent = -1;
    if (start < last) {
      // A strike at this very step was laid before, and its silent step is this one.
      first = last;
      strikes = false;
    } else if (start > 0 && this.active[(start - 1) * NUM_KEYS + key]) {
      if (end - start > 1) {
        first = start + 1;
        silent = start;
      } else if (start - 1 > last) {
        silent = start - 1;
      } else {
        strikes = false;
      }
    }
    if (silent >= 0) this.fill(key, silent, silent + 1, 0, UNKNOWN_FINGER);
    this.fill(key, first, end, 1, finger);
    if (!strikes) return -1;
    this.onset[first * NUM_KEYS + key] = 1;
    this.lastOnset[key] = first;
    return first;
  }

  private fill(key: number, first: number, end: number, active: 0 | 1, finger: number): void {
    for (let step = first; step < end; step++) {
      this.active[step * NUM_KEYS + key] = active;
      this.finger[step * NUM_KEYS + key] = finger;
    }
  }
}
