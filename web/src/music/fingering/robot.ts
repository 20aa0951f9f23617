/**
 * Fingers for the simulated hand, and what it can hold.
 *
 * A score's fingering is for people, whose thumbs pass under and whose hands stretch. The simulated hand can
 * do neither, and each shift of it costs sound. Of all ways to finger what a hand plays, the one is taken by
 * which the fewest control steps of sound are lost: those of notes that a grip does not reach, and those that
 * leaps take from the notes around them. What is written stays, unless a change brings more than
 * `CHANGE_FINGER` a note. What no fingers can hold is released early.
 */

import { MIN_PITCH, UNKNOWN_FINGER, type Note, type Score } from "../../types";
import { FINGERS_PER_HAND, HANDS, KEY_IS_BLACK, THUMB } from "../constants";
import { pressesOfHand, type Press } from "../presses";
import { floorSteps, rollOf } from "../roll";
import { trimSilence, withNotes } from "../score";
import { searchFingers, type FingerCosts, type Onset } from "./finger_search";
import { LEAP_REST, across, leapTable, outOfReach } from "./places";
import { earlyReleases, struckTogether } from "./releases";

export { ARMS_APART, KEY_SPACING, KEY_Y, LEAP_REST, handPlace, isLeap, lostToLeap } from "./places";
export { releaseEarly } from "./releases";

const CHANGE_FINGER = 0.5; // cost of a finger that is not the written one, in control steps of sound
const THUMB_ON_BLACK = 1.0; // in the same
const TOLERANCE = 0.01; // so far out of reach, a note is lost; m
const MOST_LOST = 2.0; // both notes of a grip
const CROSSED = 1000.0; // fingers that cross
const MOST_STATES = 40; // ways to lay fingers on the keys that are followed at a time

/**
 * Return a score with the fingers that suit the simulated hands best.
 *
 * Each note stays with its hand, which `robotHands` chooses before. Notes without a finger stay without.
 */
export function robotFingers(score: Score, controlTimestep: number): Score {
  const trimmed = trimSilence(score);
  const roll = rollOf(trimmed, controlTimestep);
  const found = HANDS.map(([hand, sign]) => fit(pressesOfHand(roll, hand), sign));
  const notes = score.notes.map((note, index): Note => {
    if (note.finger === UNKNOWN_FINGER) return note;
    const start = floorSteps(trimmed.notes[index]!.onset, controlTimestep);
    const hand = Math.floor(note.finger / FINGERS_PER_HAND);
    const key = note.pitch - MIN_PITCH;
    // A key struck again is silent for a step first.
    const finger =
      found[hand]!.get(placeName(key, start + 1)) ??
      found[hand]!.get(placeName(key, start + 2)) ??
      note.finger % FINGERS_PER_HAND;
    return { ...note, finger: hand * FINGERS_PER_HAND + finger };
  });
  return withNotes(score, notes);
}

function placeName(key: number, first: number): string {
  return `${key} ${first}`;
}

/**
 * Return the fingers of what a hand can hold, by key and first state.
 *
 * Fingers are chosen anew for what is left, until all of it can be held.
 */
function fit(presses: readonly Press[], sign: number): Map<string, number> {
  let left = presses;
  for (;;) {
    const chosen = choose(left, sign);
    const releases = earlyReleases(chosen, sign);
    if (releases.length === 0) {
      return new Map(chosen.map((press) => [placeName(press.key, press.first), press.finger]));
    }
    const ends = new Map(releases.map((one) => [placeName(one.key, one.onset + 1), one.release]));
    left = left
      .map((press) => ({ ...press, last: ends.get(placeName(press.key, press.first)) ?? press.last }))
      .filter((press) => press.last >= press.first);
  }
}

/** Return the presses of a hand, in order of time, with the fingers that cost the least. */
function choose(presses: readonly Press[], sign: number): Press[] {
  const fingers = searchFingers(struckTogether(presses), new Robot(sign), 1, MOST_STATES);
  return presses.map((press) => ({ ...press, finger: fingers.get(press)! }));
}

const NOTHING: Onset<Press> = { down: [], states: [[]] };

/** Costs of the fingers of a simulated hand, in control steps of sound. */
class Robot implements FingerCosts<Press, Onset<Press>> {
  /** @param sign 1 for the right hand, -1 for the left one. */
  constructor(private readonly sign: number) {}

  held(down: readonly Press[], struck: readonly Press[]): Press[] {
    // In its last state a key may come up: legato overlaps by one when it is rounded to steps.
    return down.filter((press) => press.last > struck[0]!.first);
  }

  lay(path: readonly Onset<Press>[], held: readonly Press[], struck: readonly Press[]): Onset<Press> {
    const before = path.at(-1) ?? NOTHING;
    const sorted = [...struck].sort((a, b) => across(a.key, this.sign) - across(b.key, this.sign));
    const places = held.map((press) => before.down.indexOf(press));
    const ways = before.states.map((fingers) => places.map((place) => fingers[place]!));
    const distinct = new Map(ways.map((way) => [way.join(), way]));
    const states = [...distinct.values()].flatMap((way) => {
      const free = [0, 1, 2, 3, 4].filter((finger) => !way.includes(finger));
      const chosen = combinations(free, sorted.length);
      // More than the hand can do: as it is written.
      if (chosen.length === 0) return [[...way, ...sorted.map((press) => press.finger)]];
      return chosen.map((fingers) => [...way, ...fingers]);
    });
    return { down: [...held, ...sorted], states };
  }

  costs(path: readonly Onset<Press>[], onset: Onset<Press>): Float64Array {
    const last = path.at(-1) ?? NOTHING;
    const placesBefore = onset.down.map((press) => last.down.indexOf(press));
    const isNew = placesBefore.map((place) => place < 0);
    const own = onset.states.map((fingers) => this.ownCost(onset.down, fingers, isNew));
    const doubled = onset.states.map((fingers) =>
      fingers.some((finger, place) => isNew[place]! && fingers.indexOf(finger) < place),
    );
    const leaps = this.leapsTo(onset, isNew, last);
    const cost = new Float64Array(last.states.length * onset.states.length);
    last.states.forEach((before, row) => {
      onset.states.forEach((fingers, column) => {
        const at = row * onset.states.length + column;
        const keeps = fingers.every((finger, place) => {
          return isNew[place]! || before[placesBefore[place]!] === finger;
        });
        if (!keeps) cost[at] = Infinity;
        // As it is written: there is no choice.
        else if (!doubled[column]!) {
          const [late, early] = leaps(before, fingers);
          cost[at] = own[column]! + late + early;
        }
      });
    });
    return cost;
  }

  keep(onset: Onset<Press>, kept: readonly number[]): Onset<Press> {
    return { ...onset, states: kept.map((state) => onset.states[state]!) };
  }

  /** Return what the new fingers of a state cost by themselves and with the others. */
  private ownCost(down: readonly Press[], fingers: readonly number[], isNew: readonly boolean[]): number {
    let cost = 0;
    down.forEach((press, place) => {
      if (!isNew[place]) return;
      const finger = fingers[place]!;
      cost += CHANGE_FINGER * Number(finger !== press.finger);
      cost += THUMB_ON_BLACK * Number(finger === THUMB && KEY_IS_BLACK[press.key]!);
      let grips = 0;
      for (let other = 0; other < place; other++) {
        grips += this.grip(press, finger, down[other]!, fingers[other]!);
      }
      cost += grips;
    });
    return cost;
  }

  /**
   * Return the function that tells by how much new notes begin late and ended ones end early, each summed
   * over notes, for a state before and a state now.
   */
  private leapsTo(onset: Onset<Press>, isNew: readonly boolean[], last: Onset<Press>) {
    const begun = Array.from(onset.down.keys()).filter((place) => isNew[place]);
    const ended = Array.from(last.down.keys()).filter((place) => !onset.down.includes(last.down[place]!));
    const leaps = ended.map((place) =>
      begun.map((later) => {
        const [one, other] = [last.down[place]!, onset.down[later]!];
        const rest = Math.min(other.first - one.last - 1, LEAP_REST + 1);
        return leapTable(one.key, other.key, rest, this.sign);
      }),
    );
    return (before: readonly number[], now: readonly number[]): [late: number, early: number] => {
      const late = new Float64Array(begun.length);
      let allEarly = 0;
      ended.forEach((place, i) => {
        let early = 0;
        begun.forEach((later, j) => {
          const at = before[place]! * FINGERS_PER_HAND + now[later]!;
          late[j] = Math.max(late[j]!, leaps[i]![j]!.late[at]!);
          early = Math.max(early, leaps[i]![j]!.early[at]!);
        });
        allEarly += early;
      });
      return [late.reduce((sum, one) => sum + one, 0), allEarly];
    };
  }

  /** Return what it costs that two keys are held together, by their fingers. */
  private grip(one: Press, finger: number, other: Press, otherFinger: number): number {
    const apart = across(other.key, this.sign) - across(one.key, this.sign);
    if (apart < 0) return this.grip(other, otherFinger, one, finger);
    if (finger >= otherFinger) return CROSSED;
    const together = Math.max(Math.min(one.last, other.last) - Math.max(one.first, other.first) + 1, 1);
    return together * Math.min(outOfReach(apart, finger, otherFinger) / TOLERANCE, MOST_LOST);
  }
}

/** Return all ways to choose so many numbers, in their order. */
function combinations(numbers: readonly number[], count: number): number[][] {
  if (count === 0) return [[]];
  return numbers.flatMap((first, index) =>
    combinations(numbers.slice(index + 1), count - 1).map((rest) => [first, ...rest]),
  );
}
