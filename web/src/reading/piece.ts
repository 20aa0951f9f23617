/** A piece as both hands read it, before anything is planned or simulated. */

import { ARMS_APART, releaseEarly } from "../music/fingering/robot";
import { pressesOfHand } from "../music/presses";
import type { PianoRoll } from "../types";
import { type WantedPlaces, dividingLine, wantedPlaces } from "./arms";
import type { HandShape, ReadingFacts } from "./facts";
import { type KeyFrames, keyFrames } from "./key_frames";
import { type TimedPress, timePresses } from "./presses";

/** What one hand has to do in a piece of T control steps. */
export interface HandReading extends WantedPlaces {
  /** Its presses, shortened where it has to leap, in order of time. */
  readonly presses: readonly TimedPress[];
  /** Targets of its fingertips in all T + 1 states. */
  readonly frames: KeyFrames;
  /** (T + 1) beyond which place across the keys its arm must be, m. */
  readonly bound: Float64Array;
}

/** What both hands have to do in a piece of T control steps. */
export interface Reading {
  /** The piece, with the fingers that play it; without, where a hand lets go of a note. */
  readonly roll: PianoRoll;
  /** The right and the left hand. */
  readonly hands: readonly [HandReading, HandReading];
}

/** What a piece asks of both hands; notes without a finger are left out. */
export function readPiece(roll: PianoRoll, { hands, keys }: ReadingFacts): Reading {
  const released = releaseEarly(roll);
  const states = released.steps + 1;
  const read = (hand: HandShape, side: 0 | 1) => {
    const presses = timePresses(pressesOfHand(released, side), hand.sign);
    const frames = keyFrames(presses, states, hand, keys);
    return { presses, frames, ...wantedPlaces(frames, hand.sign, hand.middle) };
  };
  const right = read(hands[0], 0);
  const left = read(hands[1], 1);
  const line = dividingLine(right, left, ARMS_APART);
  const bound = (sign: number) => line.map((place) => place + (sign * ARMS_APART) / 2);
  return { roll: released, hands: [{ ...right, bound: bound(1) }, { ...left, bound: bound(-1) }] };
}
