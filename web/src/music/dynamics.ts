/**
 * How loud a note is, as the speed of its key and as MIDI's velocity; the same map as in
 * `sb3_piano/music/dynamics.py`.
 */

import { KEY_IS_BLACK } from "./constants";

/** Angles of white and black keys that are fully down, rad. */
const [WHITE, BLACK] = [0.06656816377582381, 0.08865588186743747];
/** Velocity of a key that would make its travel once a second, and its difference to that of twice the speed. */
const [AT_ONE, PER_DOUBLING] = [-50, 25];
const [SOFTEST, LOUDEST] = [1, 127];

/** Return the MIDI velocity of a key's speed, rad/s, as it begins to sound. */
export function velocityOf(speed: number, key: number): number {
  if (speed <= 0) return SOFTEST;
  const velocity = Math.round(AT_ONE + PER_DOUBLING * Math.log2(speed / travelOf(key)));
  return Math.min(Math.max(velocity, SOFTEST), LOUDEST);
}

/** Return the speed of a key, rad/s, whose strike has a MIDI velocity. */
export function speedOf(velocity: number, key: number): number {
  return travelOf(key) * 2 ** ((velocity - AT_ONE) / PER_DOUBLING);
}

function travelOf(key: number): number {
  return KEY_IS_BLACK[key] ? BLACK : WHITE;
}
