/** Places of the keys for the fingertips that press them, m. */

import { KEY_IS_BLACK, THUMB } from "../music/constants";
import type { KeyPlaces } from "./facts";

/** Places along the keys where thumbs and where fingers press, m. */
const WHITE_X = [0.052, 0.042] as const;
const BLACK_X = [0.002, -0.002] as const;
/** The same on white keys while the hand plays black ones, too. */
const MIXED_X = [0.04, 0.026] as const;

/** How high a key's top is at `x`, m; `depth` is a share of its travel. */
export function keyHeight(keys: KeyPlaces, key: number, x: number, depth: number): number {
  return keys.top[key] - (x - keys.hinge[key]) * Math.tan(depth * keys.maxAngle[key]);
}

/**
 * Where along a key a finger, 0 (thumb) to 4, presses it, m.
 *
 * @param mixed Whether the hand plays keys of the other colour at about the same time.
 */
export function pressX(key: number, finger: number, mixed: boolean): number {
  const white = mixed ? MIXED_X : WHITE_X;
  return (KEY_IS_BLACK[key] ? BLACK_X : white)[finger === THUMB ? 0 : 1];
}
