import { NUM_KEYS } from "../types";

/** A run of control steps in which a key is down. */
export interface Run {
  readonly key: number;
  readonly first: number;
  /** The control step after the last one. */
  readonly end: number;
}

/** Unbroken runs in (steps, 88) values, ordered by first step, then key; Python's `presses_of`. */
export function runsOf(active: Uint8Array, steps: number): Run[] {
  const runs: Run[] = [];
  const begun = new Int32Array(NUM_KEYS).fill(-1);
  for (let step = 0; step <= steps; step++) {
    for (let key = 0; key < NUM_KEYS; key++) {
      const down = step < steps && active[step * NUM_KEYS + key] === 1;
      if (down && begun[key] < 0) begun[key] = step;
      if (!down && begun[key] >= 0) {
        runs.push({ key, first: begun[key], end: step });
        begun[key] = -1;
      }
    }
  }
  return runs.sort((a, b) => a.first - b.first || a.key - b.key);
}
