/** Presses of a hand as they are planned: shortened where it has to leap. */

import { LEAP_REST, handPlace, isLeap, lostToLeap } from "../music/fingering/robot";
import type { Press } from "../music/presses";
import { firstAbove } from "./sorted";

/** A press as it is planned. */
export interface TimedPress {
  /** The press of the score. */
  readonly press: Press;
  /** First and last state in which the key is to be down. */
  readonly first: number;
  readonly last: number;
  /** Whether the hand leaves for another place after it. */
  readonly leaps: boolean;
  /** Whether it came from another place. */
  readonly leapt: boolean;
  /** Whether the same finger strikes the same key again right after it. */
  readonly repeated: boolean;
}

/**
 * The presses of a hand, shortened around its leaps.
 *
 * A finger that is pressed down stands in the gap between the neighbouring keys: it has to come up before it can move
 * sideways, and the next one has to arrive before it can go down. The time for that is taken from the end of the
 * earlier note, all but one state of it, and only what is then missing from the beginning of the later one: a strike
 * that comes late is heard, a note that ends early hardly.
 *
 * @param presses In order of time, then key.
 * @param sign 1 for the right hand, -1 for the left one.
 */
export function timePresses(presses: readonly Press[], sign: number): TimedPress[] {
  const timed = presses.map((press) => ({
    press,
    first: press.first,
    last: press.last,
    leaps: false,
    leapt: false,
    repeated: false,
  }));
  const places = presses.map((press) => handPlace(press.key, press.finger, sign));
  for (const [later, earlier] of neighbours(presses)) {
    const before = presses[earlier];
    const after = presses[later];
    const distance = Math.abs(places[earlier] - places[later]);
    const rest = after.first - before.last - 1;
    const sameFinger = before.finger === after.finger;
    if (sameFinger && before.key === after.key) {
      timed[earlier].repeated = rest <= 1;
    } else if (isLeap(distance, sameFinger)) {
      const [beginsLate, endsEarly] = lostToLeap(distance, rest);
      const lost = beginsLate + endsEarly;
      const early = Math.min(lost, before.last - before.first);
      const late = Math.min(lost - early, after.last - after.first);
      timed[later].first = Math.max(timed[later].first, after.first + late);
      timed[earlier].last = Math.min(timed[earlier].last, before.last - early);
      timed[later].leapt = true;
      timed[earlier].leaps = true;
    }
  }
  // A very short note keeps one state.
  return timed.map((one) => ({
    ...one,
    first: Math.min(one.first, one.last),
    last: Math.max(one.first, one.last),
  }));
}

/** Pairs (later, earlier) of notes between whose sounding the hand strikes no other. */
function neighbours(presses: readonly Press[]): [number, number][] {
  const onsets = presses.map((press) => press.first); // ascending
  const pairs: [number, number][] = [];
  let recent: number[] = [];
  presses.forEach((press, later) => {
    recent = recent.filter((i) => press.first - presses[i].last - 1 <= LEAP_REST);
    for (const earlier of recent) {
      const before = presses[earlier].last;
      if (before < press.first && !anyBetween(onsets, before, press.first)) pairs.push([later, earlier]);
    }
    recent.push(later);
  });
  return pairs;
}

/** Whether one of some ascending numbers is above `low` and below `high`. */
function anyBetween(ascending: readonly number[], low: number, high: number): boolean {
  const next = firstAbove(ascending, low);
  return next < ascending.length && ascending[next] < high;
}
