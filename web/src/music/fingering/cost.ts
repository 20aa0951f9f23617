/**
 * Costs of a pianist's fingering: weights of its rules, and tables for one, two and three keys in succession.
 *
 * Everything here is the right hand's: the left hand is its mirror image, and so are its keys. The keyboard
 * is its own mirror image about D, so that the mirrored keys keep their colours.
 */

import { FINGERS_PER_HAND, LITTLE, MIDDLE, RING, THUMB, isBlack } from "../constants";

export const MAX_INTERVAL = 87;
const INTERVALS = 2 * MAX_INTERVAL + 1;
const OCTAVE_WIDTH = 12;
const WHITE_WIDTH = OCTAVE_WIDTH / 7;
const PITCH_CLASSES = 12;

/**
 * Limits of the distance from a finger of the right hand to a higher one, by pianists' numbers.
 *
 * In semitones, upwards positive, negative with the thumb passed under the other finger: the least that is
 * practical, comfortable, relaxed, then the most that is relaxed, comfortable, practical.
 *
 * Source: the medium hand of Balliauw, Herremans, Palhazi Cuervo and Sorensen 2017, "A variable neighborhood
 * search algorithm to generate piano fingerings for polyphonic sheet music".
 */
const MEDIUM_HAND: readonly (readonly [low: number, high: number, limits: readonly number[]])[] = [
  [1, 2, [-8, -6, 1, 5, 8, 10]],
  [1, 3, [-7, -5, 3, 9, 12, 14]],
  [1, 4, [-5, -3, 5, 11, 13, 15]],
  [1, 5, [-2, 0, 7, 12, 14, 16]],
  [2, 3, [1, 1, 1, 2, 5, 7]],
  [2, 4, [1, 1, 3, 4, 6, 8]],
  [2, 5, [2, 2, 5, 6, 10, 12]],
  [3, 4, [1, 1, 1, 2, 2, 4]],
  [3, 5, [1, 1, 3, 4, 6, 8]],
  [4, 5, [1, 1, 1, 2, 4, 6]],
];

/**
 * The cost of each rule; a fingering is the one whose costs add up to the least.
 *
 * The names in quotes are the rules of Parncutt, Sloboda, Clarke, Raekallio and Desain 1997, "An ergonomic
 * model of keyboard fingering for melodic fragments", in whose points everything counts. Distances are in
 * semitones, times in s. They are the default weights of Python's `FingeringWeights`.
 */
export const WEIGHTS = {
  physical: 0.48, // of mm in distances, the rest is semitones (Jacobs 2001)
  stretch: 2.52, // "stretch", per semitone beyond comfortable
  spanThumb: 0.93, // "small span", "large span" with the thumb, beyond relaxed
  spanFingers: 1.44, // the same without the thumb
  impractical: 10.0, // per semitone beyond practical (Balliauw et al. 2017)
  positionCount: 1.23, // "position change count", of a half change; full: twice
  positionSize: 0.71, // "position change size", per semitone beyond comfortable
  place: 0.3, // per semitone by which the thumb's place over white keys changes
  placeLater: 0.28, // the same over two keys
  sameFinger: 32.8, // one finger on two keys in succession (Balliauw et al. 2017)
  sameFingerSize: 2.1, // the same, per semitone between the keys
  otherFinger: 3.18, // another finger on the key that was struck last
  otherFingerLater: 0.79, // the same with one other key in between
  leap: 22.4, // what the movement between two keys costs at most
  weakFour: 0.55, // "weak finger", the ring finger
  weakFive: 0.67, // "weak finger", the little finger
  threeFourFive: 0.23, // "three-four-five"
  threeToFour: 0.64, // "three-to-four"
  fourOnBlack: 0.83, // "four on black", the third finger on white beside it
  thumbOnBlack: 6.79, // "thumb on black"
  thumbOnBlackWhite: 1.73, // the same, for each white key beside it
  fiveOnBlack: 0.0, // "five on black"
  fiveOnBlackWhite: 6.18, // the same, for each white key beside it
  passing: 1.24, // "thumb passing", between keys of one colour
  passingSize: 0.43, // per semitone that a finger and the thumb pass each other by
  passingOnBlack: 3.0, // "thumb passing", the thumb on black, the other on white
  chordFinger: 0.47, // as sameFinger, from or to a chord
  chordFingerSize: 0.51, // as sameFingerSize, from or to a chord
  chordShift: 0.51, // share of position changes that counts with chords among them
  chord: 4.0, // how much the reach counts between keys that are down together
  pace: 0.25, // time between notes at which the costs of movement count fully
  rest: 0.6, // silence after which they are down to 1/e
} as const;

/** Costs of two keys and their fingers; see `pairAt`. */
export type PairTable = Float64Array;

/** Return where a table has two keys: fingers 0 (thumb) to 4, `interval` in semitones up to the second. */
export function pairAt(pitchClass: number, interval: number, one: number, other: number): number {
  const keys = pitchClass * INTERVALS + interval + MAX_INTERVAL;
  return (keys * FINGERS_PER_HAND + one) * FINGERS_PER_HAND + other;
}

/** The rules worked out for all keys and fingers. */
export class CostTables {
  /** Two keys in succession; counts more the faster they follow. */
  readonly moves = pairTable();
  /** The same from or to a chord. */
  readonly chordMoves = pairTable();
  /** Colours of two keys in succession. */
  readonly colours = pairTable();
  /** Two keys that are down together. */
  readonly grips = pairTable();
  /** 1 where two keys cannot be held together by these fingers. */
  readonly far = new Uint8Array(this.grips.length);
  /** The first and third of three keys in succession. */
  readonly shifts = pairTable();
  /** The same if the thumb has the second key, between them. */
  readonly fullShifts = pairTable();

  constructor() {
    const places = keyPositions();
    for (let pitchClass = 0; pitchClass < PITCH_CLASSES; pitchClass++) {
      for (let interval = -MAX_INTERVAL; interval <= MAX_INTERVAL; interval++) {
        for (let one = 0; one < FINGERS_PER_HAND; one++) {
          for (let other = 0; other < FINGERS_PER_HAND; other++) {
            this.write(new Pair(places, pitchClass, interval, one, other));
          }
        }
      }
    }
  }

  /** Cost of a finger by itself. */
  single(black: boolean, finger: number): number {
    if (finger === THUMB) return black ? WEIGHTS.thumbOnBlack : 0;
    if (finger === RING) return WEIGHTS.weakFour;
    if (finger === LITTLE) return black ? WEIGHTS.weakFive + WEIGHTS.fiveOnBlack : WEIGHTS.weakFive;
    return 0;
  }

  /** Cost of the fingers of three keys in succession: of 3, 4 and 5 in any order. */
  triple(one: number, two: number, three: number): number {
    const weak = Math.min(one, two, three) >= MIDDLE;
    return weak && one !== two && two !== three && one !== three ? WEIGHTS.threeFourFive : 0;
  }

  private write(pair: Pair): void {
    const w = WEIGHTS;
    const { at, distance, same } = pair;
    const change = w.place * pair.displacement;
    const span = pair.thumb ? w.spanThumb : w.spanFingers;
    const strain = w.stretch * pair.comfortable + span * pair.relaxed;
    const strained = limited(strain + w.impractical * pair.practical + change);
    const moves = (sameFinger: number, size: number): number => {
      if (!same) return (distance === 0 ? w.otherFinger : strained) + passing(pair);
      return distance === 0 ? 0 : limited(sameFinger + size * Math.abs(distance) + change);
    };
    this.moves[at] = moves(w.sameFinger, w.sameFingerSize);
    this.chordMoves[at] = moves(w.chordFinger, w.chordFingerSize);
    this.colours[at] = colours(pair);
    this.grips[at] = same ? w.leap : w.chord * strained;
    this.far[at] = Number(same || pair.practical > 0);
    const shift = same ? Math.abs(distance) : pair.comfortable;
    const half =
      w.positionCount * Number(shift > 0) + w.positionSize * shift + w.placeLater * pair.displacement;
    const full = half + w.positionCount * Number(!same && pair.practical > 0);
    const later = w.otherFingerLater * Number(!same && distance === 0);
    this.shifts[at] = limited(half) + later;
    this.fullShifts[at] = limited(full) + later;
  }
}

/** Two keys with two fingers. */
class Pair {
  readonly at: number;
  readonly same: boolean;
  readonly thumb: boolean;
  /** Distance from the first key up to the second, in semitones. */
  readonly distance: number;
  /** The same from the lower-numbered finger to the other one. */
  readonly up: number;
  readonly black: boolean;
  readonly blackLater: boolean;
  /** Distance that the hand's place moves, in semitones. */
  readonly displacement: number;
  /** Distances beyond what is practical, comfortable, relaxed, in semitones. */
  readonly practical: number;
  readonly comfortable: number;
  readonly relaxed: number;

  constructor(
    places: readonly number[],
    pitchClass: number,
    readonly interval: number,
    readonly one: number,
    readonly other: number,
  ) {
    const second = pitchClass + interval;
    const octave = Math.floor(second / PITCH_CLASSES);
    const secondClass = second - octave * PITCH_CLASSES;
    this.at = pairAt(pitchClass, interval, one, other);
    this.same = one === other;
    this.thumb = one === THUMB || other === THUMB;
    this.distance = places[secondClass]! + OCTAVE_WIDTH * octave - places[pitchClass]!;
    this.up = one < other ? this.distance : -this.distance;
    this.black = isBlack(pitchClass);
    this.blackLater = isBlack(secondClass);
    this.displacement = Math.abs(this.distance - (other - one) * WHITE_WIDTH);
    const limits = reachOf(one, other);
    const beyond = (n: number) =>
      Math.max(limits[n]! - this.up, 0) + Math.max(this.up - limits[5 - n]!, 0);
    this.practical = beyond(0);
    this.comfortable = beyond(1);
    this.relaxed = beyond(2);
  }
}

function pairTable(): PairTable {
  return new Float64Array(PITCH_CLASSES * INTERVALS * FINGERS_PER_HAND * FINGERS_PER_HAND);
}

const NO_REACH = [0, 0, 0, 0, 0, 0];

function reachOf(one: number, other: number): readonly number[] {
  const [low, high] = [Math.min(one, other) + 1, Math.max(one, other) + 1];
  return MEDIUM_HAND.find(([first, second]) => first === low && second === high)?.[2] ?? NO_REACH;
}

/** Let costs grow ever more slowly: of far keys none is nearer to a finger. */
function limited(cost: number): number {
  return (cost * WEIGHTS.leap) / (cost + WEIGHTS.leap);
}

/** Return what it costs that thumb and finger pass each other. */
function passing(pair: Pair): number {
  if (!pair.thumb || pair.same || pair.up >= 0) return 0;
  const first = pair.one === THUMB;
  const thumb = first ? pair.black : pair.blackLater;
  const finger = first ? pair.blackLater : pair.black;
  // Limited, since far keys are reached with a leap, and nothing passes.
  const size = WEIGHTS.passingSize * Math.min(Math.abs(pair.interval), OCTAVE_WIDTH);
  if (thumb && !finger) return WEIGHTS.passingOnBlack + size;
  return (thumb === finger ? WEIGHTS.passing : 0) + size;
}

/** Return what the colours of two keys cost. */
function colours({ one, other, same, black, blackLater }: Pair): number {
  const w = WEIGHTS;
  const up = !black && blackLater;
  const down = black && !blackLater;
  let cost = 0;
  if (one === MIDDLE && other === RING) cost += w.threeToFour + w.fourOnBlack * Number(up);
  if (one === RING && other === MIDDLE) cost += w.fourOnBlack * Number(down);
  for (const [finger, extra] of [[THUMB, w.thumbOnBlackWhite], [LITTLE, w.fiveOnBlackWhite]] as const) {
    if (!same && down && one === finger) cost += extra;
    if (!same && up && other === finger) cost += extra;
  }
  return cost;
}

/** Return where the keys of an octave from C are, in semitones. */
function keyPositions(): number[] {
  let whites = 0;
  return Array.from({ length: PITCH_CLASSES }, (_, key) => {
    // Behind the black keys the octave is cut into five and seven nearly equal strips.
    const strip =
      key < 5
        ? ((key + 0.5) * 3 * WHITE_WIDTH) / 5
        : 3 * WHITE_WIDTH + ((key - 5 + 0.5) * 4 * WHITE_WIDTH) / 7;
    if (!isBlack(key)) whites += 1;
    const place = isBlack(key) ? strip : (whites - 1 + 0.5) * WHITE_WIDTH;
    return WEIGHTS.physical * place + (1 - WEIGHTS.physical) * (key + 0.5);
  });
}
