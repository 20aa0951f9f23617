/**
 * How loud a note is, as the speed of its key and as MIDI's velocity; the same map as in
 * `sb3_piano/music/dynamics.py`.
 */

/** Velocity of a key that is struck with 1 rad/s, and its difference to that of twice the speed. */
const [AT_ONE, PER_DOUBLING] = [62, 25];
const [SOFTEST, LOUDEST] = [1, 127];

/** Return the MIDI velocity of a key's speed, rad/s, as it begins to sound. */
export function velocityOf(speed: number): number {
  if (speed <= 0) return SOFTEST;
  return Math.min(Math.max(Math.round(AT_ONE + PER_DOUBLING * Math.log2(speed)), SOFTEST), LOUDEST);
}

/** Return the speed of a key, rad/s, whose strike has a MIDI velocity. */
export function speedOf(velocity: number): number {
  return 2 ** ((velocity - AT_ONE) / PER_DOUBLING);
}
