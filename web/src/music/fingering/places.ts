/** Places of the simulated hands across the keys, and what their leaps cost. */

import { FINGERS_PER_HAND, KEY_IS_BLACK, MIDDLE, THUMB } from "../constants";
import { roundTo } from "../numbers";

const WHITE_WIDTH = 0.0235; // m

/** (88) centres of the simulated keys across the keyboard, m. */
export const KEY_Y: readonly number[] = keyPlaces();

/** Distance of neighbouring white keys, m. */
export const KEY_SPACING = medianSpacing();

/** Least distance of the two forearms, m; they touch at 0.15. */
export const ARMS_APART = 0.16;

/** Way of the hand between two notes from which on it costs time, m. */
export const LEAP_DISTANCE = 0.02;
/** Control steps of sound that a leap costs, less the rest between the notes. */
const LEAP_STEPS = 2;
/** Ways from which on it costs one more, m. */
const LEAP_MORE = [0.09, 0.12, 0.2, 0.25];
/** Control steps of rest after which there is time enough for any leap. */
export const LEAP_REST = 12;

/**
 * Return where the middle finger would be if the fingers lay on neighbouring white keys, m.
 *
 * @param key 0 to 87.
 * @param finger the finger on it, from 0, the thumb, to 4.
 * @param sign 1 for the right hand, -1 for the left one.
 */
export function handPlace(key: number, finger: number, sign: number): number {
  return KEY_Y[key]! - sign * (finger - MIDDLE) * KEY_SPACING;
}

/** Return whether the hand has to come up between notes on keys so far (m) apart for it. */
export function isLeap(distance: number, sameFinger: boolean): boolean {
  return sameFinger || distance > LEAP_DISTANCE;
}

/**
 * Return by how many control steps the later note begins late, and the earlier one ends early.
 *
 * The hand has to go `distance` m, and there are `rest` control steps between the notes.
 */
export function lostToLeap(distance: number, rest: number): [late: number, early: number] {
  const steps = Math.trunc(leapSteps(distance, rest));
  const late = Math.floor((steps + 1) / 2);
  return [late, steps - late];
}

/** Return the control steps of sound that a leap of so many m costs after so many steps of rest. */
export function leapSteps(distance: number, rest: number): number {
  const more = LEAP_MORE.filter((way) => way < distance).length;
  return Math.max(LEAP_STEPS + more - rest, 0);
}

/** Finger pairs that the rules below are tables of: row `lower finger`, column `higher finger`. */
type FingerTable = readonly (readonly number[])[];

// How far apart two fingertips can press white keys, by inverse kinematics of the hand, less a
// margin for other keys and fingers; m. Rows and columns are fingers, from thumb to little finger.
const NEAREST: FingerTable = [
  [0, 0.0, 0.01, 0.02, 0.03],
  [0, 0.0, 0.012, 0.028, 0.04],
  [0, 0.0, 0.0, 0.012, 0.025],
  [0, 0.0, 0.0, 0.0, 0.012],
  [0, 0.0, 0.0, 0.0, 0.0],
];
const FARTHEST: FingerTable = [
  [0, 0.074, 0.096, 0.14, 0.18],
  [0, 0.0, 0.06, 0.098, 0.102],
  [0, 0.0, 0.0, 0.07, 0.078],
  [0, 0.0, 0.0, 0.0, 0.066],
  [0, 0.0, 0.0, 0.0, 0.0],
];

/** Return the place of a key, from the thumb's side to the little finger's, m. */
export function across(key: number, sign: number): number {
  return sign * KEY_Y[key]!;
}

/**
 * Return how far two keys are out of reach, m, for two fingers of which the second is higher.
 *
 * `apart` is how much nearer to the little finger's side the second key is, m.
 */
export function outOfReach(apart: number, low: number, high: number): number {
  return Math.max(apart - FARTHEST[low]![high]!, NEAREST[low]![high]! - apart, 0);
}

/** Return the cost of leaving a key for another one, as `leapTable` counts it. */
export interface LeapTable {
  /** (5, 5) control steps by which the later note begins late, by the fingers of both notes. */
  readonly late: Float64Array;
  /** (5, 5) control steps by which the earlier note ends early. */
  readonly early: Float64Array;
}

const REPEATED = 0.5; // a strike of the same key by the same finger
const LEAP_WEIGHT = 5.0; // the way of a leap, per m: the shorter one, if as much is lost
const PASSED = 2.0; // a finger, not the thumb, that passes another one
const tables = new Map<string, LeapTable>();

/** Return how late a note begins and how early the one before ends after `rest` control steps. */
export function leapTable(key: number, laterKey: number, rest: number, sign: number): LeapTable {
  const name = `${key} ${laterKey} ${rest} ${sign}`;
  let table = tables.get(name);
  if (!table) {
    table = makeLeapTable(key, laterKey, rest, sign);
    tables.set(name, table);
  }
  return table;
}

function makeLeapTable(key: number, laterKey: number, rest: number, sign: number): LeapTable {
  const size = FINGERS_PER_HAND * FINGERS_PER_HAND;
  const late = new Float64Array(size);
  const early = new Float64Array(size);
  if (rest > LEAP_REST) return { late, early };
  const outwards = sign * KEY_Y[laterKey]! > sign * KEY_Y[key]!;
  for (let finger = 0; finger < FINGERS_PER_HAND; finger++) {
    for (let other = 0; other < FINGERS_PER_HAND; other++) {
      const at = finger * FINGERS_PER_HAND + other;
      if (finger === other && key === laterKey) {
        late[at] = rest === 0 ? REPEATED : 0;
        continue;
      }
      const distance = Math.abs(handPlace(key, finger, sign) - handPlace(laterKey, other, sign));
      if (!isLeap(distance, finger === other)) continue;
      const [lateSteps, earlySteps] = lostToLeap(distance, rest);
      const crosses = outwards ? other < finger : other > finger;
      const passes = finger !== THUMB && other !== THUMB && crosses;
      late[at] = lateSteps + LEAP_WEIGHT * distance + PASSED * Number(passes);
      early[at] = earlySteps;
    }
  }
  return { late, early };
}

function keyPlaces(): number[] {
  let whites = 0;
  return KEY_IS_BLACK.map((black, key) => {
    if (!black) whites += 1;
    const white = (whites - 1 - 25.5) * WHITE_WIDTH;
    return roundTo(black ? white + WHITE_WIDTH / 2 + (key > 1 ? 0.0005 : 0) : white, 5);
  });
}

function medianSpacing(): number {
  const whites = KEY_Y.filter((_, key) => !KEY_IS_BLACK[key]);
  const spacings = whites.slice(1).map((place, index) => place - whites[index]!);
  return spacings.sort((a, b) => a - b)[(spacings.length - 1) / 2]!;
}
