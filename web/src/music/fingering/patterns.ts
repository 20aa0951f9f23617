/** Ways to lay fingers on keys, whenever and in whichever octave they are played. */

import { UNKNOWN_FINGER } from "../../types";
import { FINGERS_PER_HAND, THUMB } from "../constants";
import type { States } from "./finger_search";

/** For each key from the thumb's side: whether it is struck now (else held), its known finger or -1. */
export type Shape = readonly (readonly [struck: boolean, label: number])[];

/** Keys that are down, whenever and in whichever octave they are played. */
export interface Pattern {
  /** Equal for equal patterns. */
  readonly name: string;
  /** Of the lowest key, 0 is C. */
  readonly pitchClass: number;
  /** Of each key above the lowest, in semitones. */
  readonly intervals: readonly number[];
  readonly shape: Shape;
  readonly states: States;
  /** Places of the keys that are struck. */
  readonly struck: readonly number[];
}

/** Results by name; the oldest are forgotten, since a page may stay open for long. */
export class Memo<T> {
  private readonly results = new Map<string, T>();

  constructor(private readonly most = 8192) {}

  get(name: string, make: () => T): T {
    const known = this.results.get(name);
    if (known !== undefined) return known;
    const made = make();
    if (this.results.size >= this.most) this.results.delete(this.results.keys().next().value!);
    this.results.set(name, made);
    return made;
  }
}

const allStates = new Memo<States>();
const allPlayable = new Memo<readonly number[]>();
const allPatterns = new Memo<Pattern>();

/**
 * Return the pattern of keys that are down.
 *
 * @param pitchClass of the lowest key.
 * @param intervals of each key above the lowest.
 * @param shape of these keys.
 * @param inOrder whether fingers follow the order of the keys.
 */
export function patternOf(
  pitchClass: number,
  intervals: readonly number[],
  shape: Shape,
  inOrder: boolean,
): Pattern {
  const name = `${pitchClass}|${intervals.join()}|${shapeName(shape, inOrder)}`;
  return allPatterns.get(name, () => ({
    name,
    pitchClass,
    intervals,
    shape,
    states: statesOf(shape, inOrder),
    struck: shape.flatMap(([struck], place) => (struck ? [place] : [])),
  }));
}

/**
 * Return every way to lay fingers on the keys, in a definite order.
 *
 * Each key has a finger of its own, and fingers follow the order of the keys if they are to. Two exceptions:
 * the thumb may have passed under fingers that hold keys, or fingers over a thumb that does; and labels stay
 * as they are, even if two contradict each other.
 */
export function statesOf(shape: Shape, inOrder: boolean): States {
  return allStates.get(shapeName(shape, inOrder), () => {
    let states: (readonly number[])[] = [[]];
    shape.forEach(([, label], place) => {
      const choices = label === UNKNOWN_FINGER ? [0, 1, 2, 3, 4] : [label];
      states = states.flatMap((state) =>
        choices
          .filter((finger) => state.every((low, below) => fits(shape, below, low, place, finger, inOrder)))
          .map((finger) => [...state, finger]),
      );
    });
    return states;
  });
}

function fits(
  shape: Shape,
  below: number,
  low: number,
  above: number,
  high: number,
  inOrder: boolean,
): boolean {
  const [lowStruck, lowLabel] = shape[below]!;
  const [highStruck, highLabel] = shape[above]!;
  if (lowLabel !== UNKNOWN_FINGER && highLabel !== UNKNOWN_FINGER) return true;
  if (low === high) return false;
  return !inOrder || low <= high || (high === THUMB && !(lowStruck && highStruck));
}

/**
 * Return the places of the struck keys that get a finger.
 *
 * Those with labels do; if there are more than five others, the outer ones come first.
 */
export function playable(shape: Shape): readonly number[] {
  return allPlayable.get(shapeName(shape, true), () => {
    const places = Array.from(shape.keys());
    const labelled = places.filter((place) => shape[place]![1] !== UNKNOWN_FINGER);
    const free = places.filter((place) => shape[place]![1] === UNKNOWN_FINGER);
    for (let count = Math.min(free.length, FINGERS_PER_HAND); count > 0; count--) {
      // Turn by turn from both ends.
      const outer = Array.from({ length: count }, (_, turn) =>
        free.at(turn % 2 === 0 ? turn >> 1 : -1 - (turn >> 1))!,
      );
      const chosen = [...labelled, ...outer].sort((a, b) => a - b);
      const part = chosen.map((place) => shape[place]!);
      if ([true, false].some((inOrder) => statesOf(part, inOrder).length > 0)) return chosen;
    }
    return labelled;
  });
}

function shapeName(shape: Shape, inOrder: boolean): string {
  return `${inOrder}${shape.map(([struck, label]) => `${struck ? "s" : "h"}${label}`).join("")}`;
}
