/** What each finger of a hand does next. */

import { FINGERS_PER_HAND } from "../music/constants";
import type { HandReading } from "../reading/piece";
import type { TimedPress } from "../reading/presses";
import { firstAbove } from "../reading/sorted";
import type { PianoRoll } from "../types";

/** A press with what the observation tells of it. */
export interface ShownPress {
  readonly timed: TimedPress;
  /** Where the fingertip is when the key is down: index of x in the targets of the key frames. */
  readonly point: number;
  /** When its note begins and when it ends as it is written, s from the start. */
  readonly onset: number;
  readonly offset: number;
}

/** The presses of each finger of a hand, and which of them is under way or next in each state. */
export class FingerPresses {
  private readonly presses: ShownPress[][] = Array.from({ length: FINGERS_PER_HAND }, () => []);
  /** For each finger and press, until which state that and those before it last. */
  private readonly ends: number[][] = Array.from({ length: FINGERS_PER_HAND }, () => []);

  constructor(hand: HandReading, { strikes, controlTimestep }: PianoRoll) {
    const onsets = new Map(strikes.map(({ step, key, time }) => [`${step} ${key}`, time]));
    for (const timed of hand.presses) {
      const { key, finger, first, last } = timed.press;
      const start = first - 1; // the control step that leads to the first state
      const state = Math.min(timed.first, hand.frames.states - 1);
      const ends = this.ends[finger];
      ends.push(Math.max(timed.last, ends.at(-1) ?? 0));
      this.presses[finger].push({
        timed,
        point: 3 * (state * FINGERS_PER_HAND + finger),
        onset: onsets.get(`${start} ${key}`) ?? start * controlTimestep,
        offset: last * controlTimestep,
      });
    }
  }

  /** A finger's press under way in a state, or else the next (`ahead` 0), or that after it (1), and so on. */
  find(finger: number, state: number, ahead: number): ShownPress | undefined {
    return this.presses[finger][firstAbove(this.ends[finger], state) + ahead];
  }
}
