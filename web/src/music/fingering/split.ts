/** Hands for a score: which hand plays a note when the file does not say. */

import type { Note, Score } from "../../types";
import { FINGERS_PER_HAND, HANDS } from "../constants";
import { clip } from "../numbers";
import { withNotes } from "../score";
import {
  extentOf, inOrder, lowestLeft, searchHands,
  type Chord, type Extent, type HandCosts, type HandState, type HandStates, type Move, type Share,
} from "./hand_search";
import { TOGETHER } from "./together";

// What it costs to give notes to a hand. Widths and ways are in semitones.
const WIDTH = 0.1; // per semitone between the lowest and the highest key a hand strikes together
const COMFORTABLE = 12; // width from which a semitone costs more, ...
const WIDE = 1.0; // ... and how much
const HELD = 0.3; // per semitone and finger that held keys add, ...
const HELD_MOST = 3.0; // ... at most this, since they can be let go of
const FINGER = 5.0; // for each key beyond five that a hand has to strike together
const ENTRY = 0.5; // for a hand that strikes for the first time
const WAY = 0.06; // per semitone that the middle of a hand moves
const REACH = 9.0; // way from which a semitone costs more, ...
const FAR = 0.15; // ... and how much
const CROSSING = 1.0; // for keys beyond the other hand's last ones, ...
const CROSSING_SIZE = 0.2; // ... and per semitone
const MEMORY = 1.0; // s after which a hand's last place matters 1/e as much for crossing
const CENTRE = 60;
const REGISTER = 0.03; // per semitone of the right hand below this pitch, the left above
const SLOWEST = 0.3; // between these ...
const FASTEST = 2.0; // ... the time there is weighs the ways
const PACE = 0.25; // s since a hand last struck at which ways cost what is said here

// A hand's state: the middle of what it struck last and its key nearest to the other hand, both as MIDI
// pitches, and when that was, s.
const PLACE = 0;
const EDGE = 1;
const STRUCK = 2;

/**
 * Return the score with a hand for each note.
 *
 * Hands that are known stay. The others are found by a beam search over the keys struck at a time: of these
 * the left hand takes the lower ones, so that hands never cross within a chord, and it costs something for
 * a hand to stretch, to travel, or to strike beyond the other hand.
 */
export function assignHands(score: Score): Score {
  if (score.notes.every((note) => note.hand !== null)) return score;
  const hands = searchHands(score.notes, pianist);
  return withNotes(score, score.notes.map((note, index) => ({ ...note, hand: hands[index]! })));
}

const pianist: HandCosts = {
  start: [0, 0, -Infinity],

  options(struck) {
    const shares = lowestLeft(struck).map((share) =>
      share.map((left, place) => (struck[place]!.hand === null ? left : struck[place]!.hand === 1)),
    );
    return inOrder(shares);
  },

  costsOf(chord, options) {
    const parts = HANDS.map(([hand, sign]) =>
      options.map((option) => new Part(chord, option, hand, sign)),
    );
    return (states: HandStates, held: Share, option: number): Move => {
      let cost = 0;
      const after: [HandState, HandState] = [...states];
      for (const [hand] of HANDS) {
        const part = parts[hand]![option]!;
        if (part.takes.count === 0) continue;
        cost += part.cost(states, held);
        after[hand] = part.after;
      }
      return { cost, states: after };
    };
  },
};

/** What one hand strikes; as seen from the right hand: the left hand's keys are turned upside down. */
class Part {
  readonly takes: Extent;
  readonly after: HandState;
  private readonly held: readonly number[];
  private readonly middle: number;
  private readonly register: number;

  constructor(
    private readonly chord: Chord,
    option: Share,
    private readonly hand: 0 | 1,
    private readonly sign: number,
  ) {
    const keys = chord.struck.map((note: Note) => sign * note.pitch);
    this.takes = extentOf(keys, option, hand);
    this.held = chord.held.map((note) => sign * note.pitch);
    this.middle = (sign * (this.takes.low + this.takes.high)) / 2;
    this.after = [this.middle, sign * this.takes.low, chord.onset];
    let wrong = 0;
    chord.struck.forEach((note, place) => {
      if (Number(option[place]) === hand) wrong += Math.max(sign * (CENTRE - note.pitch), 0);
    });
    this.register = REGISTER * wrong;
  }

  cost(states: HandStates, held: Share): number {
    const { onset } = this.chord;
    const way = wayCost(states[this.hand], this.middle, onset);
    const crossing = crossingCost(states[1 - this.hand]!, this.sign, this.takes.low, onset);
    return this.grip(held) + way + crossing + this.register;
  }

  /** Cost of striking and holding keys together. */
  private grip(held: Share): number {
    const { low, high, count } = this.takes;
    const width = high - low;
    const strikes =
      WIDTH * width + WIDE * Math.max(width - COMFORTABLE, 0) + FINGER * Math.max(count - FINGERS_PER_HAND, 0);
    const holds = extentOf(this.held, held, this.hand);
    if (holds.count === 0) return strikes;
    const whole = Math.max(high, holds.high) - Math.min(low, holds.low);
    const added = Math.max(whole, COMFORTABLE) - Math.max(width, COMFORTABLE);
    const fingers = Math.max(count + holds.count - FINGERS_PER_HAND, 0);
    return strikes + Math.min(HELD * added + HELD * fingers, HELD_MOST);
  }
}

function wayCost(state: HandState, middle: number, onset: number): number {
  const way = Math.abs(middle - state[PLACE]);
  const cost = WAY * way + FAR * Math.max(way - REACH, 0);
  const time = Math.max(onset - state[STRUCK], TOGETHER);
  return Number.isFinite(time) ? clip(Math.sqrt(PACE / time), SLOWEST, FASTEST) * cost : ENTRY;
}

function crossingCost(other: HandState, sign: number, low: number, onset: number): number {
  const depth = sign * other[EDGE] - low;
  if (depth < 0) return 0;
  return Math.exp(-(onset - other[STRUCK]) / MEMORY) * (CROSSING + CROSSING_SIZE * depth);
}
