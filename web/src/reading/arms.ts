/** Dividing line between the two arms, state by state, m. */

import { FINGERS_PER_HAND, MIDDLE } from "../music/constants";
import { KEY_SPACING } from "../music/fingering/robot";
import type { KeyFrames } from "./key_frames";

/** A hand counts as busy so many states before and after it plays. */
const BUSY_STATES = 6;

/** Additional distance of an arm that plays nothing, m. */
const IDLE_APART = 0.05;

/** Where a hand would be if it were alone, over s states. */
export interface WantedPlaces {
  /** (s) places of the middle finger across the keys, m. */
  readonly place: Float64Array;
  /** (s) 1 where the hand is busy. */
  readonly busy: Uint8Array;
}

/**
 * Where across the keys a hand would be if it were alone.
 *
 * @param sign 1 for the right hand, -1 for the left one.
 * @param rest Where it rests, m.
 */
export function wantedPlaces(frames: KeyFrames, sign: number, rest: number): WantedPlaces {
  const place = new Float64Array(frames.states).fill(rest);
  const busy = new Uint8Array(frames.states);
  let before = -1; // the last state in which the hand was asked for
  for (let state = 0; state < frames.states; state++) {
    const mean = meanPlace(frames, state, sign);
    if (mean === null) continue;
    busy.fill(1, Math.max(state - BUSY_STATES, 0), state + BUSY_STATES + 1);
    place[state] = mean;
    interpolate(place, before, state);
    before = state;
  }
  if (before >= 0) place.fill(place[before], before);
  return { place, busy };
}

/** Mean of where the fingers want the hand in a state, by their weights, m; null if none has anything to do. */
function meanPlace(frames: KeyFrames, state: number, sign: number): number | null {
  let total = 0;
  let sum = 0;
  for (let finger = 0; finger < FINGERS_PER_HAND; finger++) {
    const at = state * FINGERS_PER_HAND + finger;
    total += frames.weight[at];
    sum += frames.weight[at] * (frames.target[3 * at + 1] - sign * KEY_SPACING * (finger - MIDDLE));
  }
  return total > 0 ? sum / total : null;
}

/** Fill what lies between two states, or before the second one if the first is -1, by straight lines. */
function interpolate(place: Float64Array, from: number, to: number): void {
  const slope = from < 0 ? 0 : (place[to] - place[from]) / (to - from);
  const start = from < 0 ? place[to] : place[from];
  for (let state = from + 1; state < to; state++) place[state] = start + slope * (state - from);
}

/**
 * A first line between the arms, (s) m.
 *
 * Where both are busy it lies in the middle; a hand that plays makes one that rests give way.
 *
 * @param apart Least distance of the arms, m.
 */
export function dividingLine(right: WantedPlaces, left: WantedPlaces, apart: number): Float64Array {
  return right.place.map((place, state) => {
    const plays = [right.busy[state], left.busy[state]];
    const extra = plays[0] && plays[1] ? 0 : IDLE_APART;
    const short = Math.max(left.place[state] + apart + extra - place, 0);
    const share = plays[0] === plays[1] ? 0.5 : plays[0] ? 0 : 1;
    return (place + share * short + (left.place[state] - (1 - share) * short)) / 2;
  });
}
