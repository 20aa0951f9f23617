import { runsOf, type Run } from "../music/runs";
import { NUM_KEYS, type PianoRoll } from "../types";

/** A run in which a key should be down, and the finger that should hold it, -1 if unknown. */
export interface RollNote extends Run {
  readonly finger: number;
}

/** The notes of a roll, ordered by first step, then key; a key struck again without a silent step stays one note. */
export function notesOf(roll: PianoRoll): RollNote[] {
  return runsOf(roll.active, roll.steps).map((run) => ({
    ...run,
    finger: roll.finger[run.first * NUM_KEYS + run.key],
  }));
}
