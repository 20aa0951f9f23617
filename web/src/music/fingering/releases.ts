/** Notes that a simulated hand lets go of, since its fingers cannot hold them beside others. */

import { NUM_KEYS, UNKNOWN_FINGER, type PianoRoll } from "../../types";
import { FINGERS_PER_HAND, HANDS } from "../constants";
import { pressesOfHand, type Press } from "../presses";
import { across, outOfReach } from "./places";

// So far out of reach, m, fingers end up between the keys.
const MAX_OVERREACH = 0.018;

/** A note that its hand does not hold to its end, or does not strike, to play another. */
export interface EarlyRelease {
  /** 0 to 87. */
  readonly key: number;
  /** The finger that would hold it, 0 to 9. */
  readonly finger: number;
  /** Its first control step. */
  readonly onset: number;
  /** The control step after its last one. */
  readonly offset: number;
  /** From this control step on no finger holds it; `onset` if it is not struck at all. */
  readonly release: number;
  /** The key that is played instead, 0 to 87. */
  readonly forKey: number;
}

/** A roll in which no hand holds what its fingers cannot hold together. */
export interface HeldRoll extends PianoRoll {
  /** Notes that have no finger in (a part of) their steps. */
  readonly earlyReleases: readonly EarlyRelease[];
}

/** Return a roll in which no note has a finger from where on its hand releases it to play another. */
export function releaseEarly(roll: PianoRoll): HeldRoll {
  const finger = roll.finger.slice();
  const found = HANDS.flatMap(([hand, sign]) => earlyReleases(pressesOfHand(roll, hand), sign));
  for (const one of found) {
    for (let step = one.release; step < one.offset; step++) {
      finger[step * NUM_KEYS + one.key] = UNKNOWN_FINGER;
    }
  }
  return { ...roll, finger, earlyReleases: found };
}

/**
 * Return what a hand has to release early so that it can play the others.
 *
 * What is held already makes way for what is struck. Of a chord that cannot be struck, the note goes
 * that is out of reach for most of the others; of equals, the one nearest to the thumb.
 *
 * @param presses what the hand plays, in order of time.
 * @param sign 1 for the right hand, -1 for the left one.
 */
export function earlyReleases(presses: readonly Press[], sign: number): EarlyRelease[] {
  const releases: EarlyRelease[] = [];
  let held: Press[] = [];
  for (const chord of struckTogether(presses)) {
    const struck = [...chord];
    const onset = chord[0]!.first;
    const conflicts = (one: Press) =>
      struck.filter((other) => other !== one && !holds(one, other, sign));
    const makesWay = (press: Press): boolean => {
      const against = conflicts(press);
      if (against.length > 0) releases.push(releaseOf(press, onset - 1, against[0]!.key, sign));
      return against.length > 0;
    };
    for (;;) {
      const worst = mostInTheWay(struck, conflicts, sign);
      if (!makesWay(worst)) break;
      struck.splice(struck.indexOf(worst), 1);
    }
    held = [...held.filter((press) => press.last >= onset && !makesWay(press)), ...struck];
  }
  return releases;
}

/** Return presses in groups of those that begin in one state; they are in order of time. */
export function struckTogether(presses: readonly Press[]): Press[][] {
  const chords: Press[][] = [];
  for (const press of presses) {
    const last = chords.at(-1);
    if (last && last[0]!.first === press.first) last.push(press);
    else chords.push([press]);
  }
  return chords;
}

function mostInTheWay(
  struck: readonly Press[],
  conflicts: (one: Press) => readonly Press[],
  sign: number,
): Press {
  let worst = struck[0]!;
  let most = conflicts(worst).length;
  for (const press of struck.slice(1)) {
    const count = conflicts(press).length;
    const nearer = across(press.key, sign) < across(worst.key, sign);
    if (count > most || (count === most && nearer)) {
      worst = press;
      most = count;
    }
  }
  return worst;
}

function releaseOf(press: Press, release: number, forKey: number, sign: number): EarlyRelease {
  return {
    key: press.key,
    finger: press.finger + (sign < 0 ? FINGERS_PER_HAND : 0),
    onset: press.first - 1,
    offset: press.last,
    release,
    forKey,
  };
}

/** Return whether a hand can hold two keys together. */
function holds(one: Press, other: Press, sign: number): boolean {
  const swapped = across(other.key, sign) < across(one.key, sign);
  const [low, high] = swapped ? [other, one] : [one, other];
  // Fingers that cross are another matter.
  if (low.finger >= high.finger) return low.finger !== high.finger;
  const apart = across(high.key, sign) - across(low.key, sign);
  return outOfReach(apart, low.finger, high.finger) <= MAX_OVERREACH;
}
