/** Presses: keys with the fingers that hold them, from state to state. */

import { NUM_KEYS, UNKNOWN_FINGER, type PianoRoll } from "../types";
import { FINGERS_PER_HAND } from "./constants";

/**
 * A key held by a finger.
 *
 * Control step t leads from state t to state t + 1, and what sounds in state t + 1 is compared with
 * the goal of step t: the key must be down in the states `first` to `last`.
 */
export interface Press {
  /** 0 to 87. */
  readonly key: number;
  /** 0 (thumb) to 4 (little finger) of the hand. */
  readonly finger: number;
  /** First state in which the key is down, 1 or more. */
  readonly first: number;
  /** Last one, `first` or more. */
  readonly last: number;
}

/** Return what a hand, 0 (right) or 1 (left), has to play, in order of time, then key. */
export function pressesOfHand(roll: PianoRoll, hand: 0 | 1): Press[] {
  const presses: Press[] = [];
  for (let key = 0; key < NUM_KEYS; key++) {
    let start = 0;
    for (let step = 1; step <= roll.steps; step++) {
      const label = labelAt(roll, start, key);
      // A note that outlasts another one on its key sounds on with its own label: a new press.
      const ends =
        step === roll.steps ||
        labelAt(roll, step, key) !== labelAt(roll, step - 1, key) ||
        roll.onset[step * NUM_KEYS + key] === 1;
      if (!ends) continue;
      if (label !== UNKNOWN_FINGER && Math.floor(label / FINGERS_PER_HAND) === hand) {
        presses.push({ key, finger: label % FINGERS_PER_HAND, first: start + 1, last: step });
      }
      start = step;
    }
  }
  return presses.sort((a, b) => a.first - b.first || a.key - b.key);
}

function labelAt(roll: PianoRoll, step: number, key: number): number {
  const at = step * NUM_KEYS + key;
  return roll.active[at] ? roll.finger[at]! : UNKNOWN_FINGER;
}
