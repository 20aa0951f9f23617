/** Targets of a hand's fingertips, state by state, m. */

import { FINGERS_PER_HAND, KEY_IS_BLACK } from "../music/constants";
import { handPlace } from "../music/fingering/robot";
import type { HandShape, KeyPlaces } from "./facts";
import { keyHeight, pressX } from "./keyboard";
import type { TimedPress } from "./presses";

/** Height over a key of a finger that will soon play it, m. */
const HOVER = 0.01;
/** Depth of a key while it is down, a share of its travel. */
const HOLD_DEPTH = 1.05;

/** What may replace what: a finger that lets go a key has the right of way over its next approach. */
const RANK = { hover: 1, lift: 2, ready: 3, release: 4, hold: 5 } as const;

/** For so many states a finger hovers over its next key. */
const HOVER_STATES = 8;
/** Distance of a hand from a key within which a finger already moves towards it, m. */
const REACH = 0.06;

// Depths of a key: two states before it is down; in the state before, well on its way but not yet sounding; in the
// state before after a leap, when there is less time; between two strikes of it by the same finger, if there is no
// more time; in the state after; there, if the hand moves elsewhere.
const LIFT_DEPTH = -0.5;
const READY_DEPTH = 0.6;
const LEAP_READY_DEPTH = -0.2;
const REPEAT_DEPTH = 0.45;
const RELEASE_DEPTH = 0.2;
const LEAP_RELEASE_DEPTH = -1.2;

/** Weight across the keys, per m, and how much each of the targets counts, as shares of it. */
const WEIGHT = 10;
const READY_SHARE = 0.8;
const LIFT_SHARE = 0.6;
const LEAST_HOVER_SHARE = 0.1;
const LEAP_RELEASE_SHARE = 0.5;

/** Notes of the other colour so few states away make a passage mixed. */
const MIXED_STATES = 3;

/** Targets of five fingertips over s states; state 0 is the start. Row by row. */
export class KeyFrames {
  /** (s, 5, 3) places, m. */
  readonly target: Float64Array;
  /** (s, 5) how much they count across the keys, per m; 0 where a finger has nothing to do. */
  readonly weight: Float64Array;
  private readonly rank: Uint8Array;

  constructor(readonly states: number) {
    this.target = new Float64Array(states * FINGERS_PER_HAND * 3);
    this.weight = new Float64Array(states * FINGERS_PER_HAND);
    this.rank = new Uint8Array(states * FINGERS_PER_HAND);
  }

  /** Write a target, unless something more important is there. */
  put(state: number, finger: number, rank: number, target: Point, share: number): void {
    const at = state * FINGERS_PER_HAND + finger;
    if (state <= 0 || state >= this.states || rank < this.rank[at]) return;
    this.target.set(target, 3 * at);
    this.weight[at] = WEIGHT * share;
    this.rank[at] = rank;
  }
}

/** x, y, z in the world, m. */
type Point = readonly [number, number, number];

/**
 * What a hand's presses ask of its fingertips.
 *
 * @param timed The presses, in order of time.
 * @param states How many states there are.
 */
export function keyFrames(
  timed: readonly TimedPress[],
  states: number,
  hand: HandShape,
  keys: KeyPlaces,
): KeyFrames {
  const frames = new KeyFrames(states);
  const held = heldPlaces(timed, hand.sign, states);
  const mixed = mixedPassages(timed);
  const last = new Array<number>(FINGERS_PER_HAND).fill(0); // until when each finger holds its note before
  timed.forEach((one, index) => {
    const { key, finger } = one.press;
    const place = handPlace(key, finger, hand.sign);
    const x = pressX(key, finger, mixed[index]);
    const start = Math.max(last[finger] + 2, one.first - HOVER_STATES, 0);
    const free = (state: number) =>
      state >= start && state < states && isFree(held[state], finger, place);
    writePress(frames, one, start, free, (depth, above = 0) => [
      x,
      keys.y[key],
      keyHeight(keys, key, x, depth) + hand.radius[finger] + above,
    ]);
    last[finger] = Math.max(last[finger], one.last);
  });
  return frames;
}

/**
 * Write how a finger comes to a key, holds it and leaves it.
 *
 * @param start First state in which the finger may be on its way.
 * @param free In which states the hand is near enough for that.
 * @param at Where the fingertip is when the key is at a depth, or so many m above that.
 */
function writePress(
  frames: KeyFrames,
  one: TimedPress,
  start: number,
  free: (state: number) => boolean,
  at: (depth: number, above?: number) => Point,
): void {
  const finger = one.press.finger;
  const strike = one.first - 1; // the state before the key is down
  for (let state = start; state < strike - 1; state++) {
    const near = 1 - (strike - state) / HOVER_STATES;
    const share = Math.max(LEAST_HOVER_SHARE, near ** 3);
    if (free(state)) frames.put(state, finger, RANK.hover, at(0, HOVER), share);
  }
  if (free(strike - 1)) frames.put(strike - 1, finger, RANK.lift, at(LIFT_DEPTH), LIFT_SHARE);
  const ready = one.leapt ? LEAP_READY_DEPTH : READY_DEPTH;
  frames.put(strike, finger, RANK.ready, at(ready), READY_SHARE);
  for (let state = one.first; state <= one.last; state++) {
    frames.put(state, finger, RANK.hold, at(HOLD_DEPTH), 1);
  }
  const left = one.leaps ? LEAP_RELEASE_DEPTH : RELEASE_DEPTH;
  const depth = one.repeated ? REPEAT_DEPTH : left;
  frames.put(one.last + 1, finger, RANK.release, at(depth), one.leaps ? LEAP_RELEASE_SHARE : 1);
}

/** A finger that holds a key, and where that wants its hand to be, m. */
interface Held {
  readonly finger: number;
  readonly place: number;
}

/** For each state, which fingers hold keys. */
function heldPlaces(timed: readonly TimedPress[], sign: number, states: number): Held[][] {
  const held: Held[][] = Array.from({ length: states }, () => []);
  for (const { press, first, last } of timed) {
    const place = handPlace(press.key, press.finger, sign);
    for (let state = first; state < Math.min(last + 1, states); state++) {
      held[state].push({ finger: press.finger, place });
    }
  }
  return held;
}

/** Whether no other finger holds the hand too far away from a place. */
function isFree(held: readonly Held[], finger: number, place: number): boolean {
  return held.every((other) => other.finger === finger || Math.abs(place - other.place) <= REACH);
}

/** For each press, whether its hand plays keys of the other colour about then. */
function mixedPassages(timed: readonly TimedPress[]): boolean[] {
  return timed.map(({ press }) =>
    timed.some(
      ({ press: other }) =>
        other.first <= press.last + MIXED_STATES &&
        other.last >= press.first - MIXED_STATES &&
        KEY_IS_BLACK[other.key] !== KEY_IS_BLACK[press.key],
    ),
  );
}
