/**
 * Hands for the simulated hands, whose forearms need room and whose leaps cost sound.
 *
 * What a score gives to a hand is for people, whose arms pass each other and whose hands meet on
 * neighbouring keys. The simulated forearms are 15 cm thick and stay beside each other: where both hands are
 * needed at one place, one of them is not there. A note goes to the other hand where that saves sound.
 * Costs are in control steps of sound.
 */

import { MIN_PITCH, UNKNOWN_FINGER, type Note, type Score } from "../../types";
import { FINGERS_PER_HAND, HANDS } from "../constants";
import { clip } from "../numbers";
import { withNotes } from "../score";
import {
  extentOf, inOrder, lowestLeft, searchHands,
  type Chord, type Extent, type HandCosts, type HandState, type HandStates, type Move, type Share,
} from "./hand_search";
import { ARMS_APART, KEY_SPACING, KEY_Y, LEAP_DISTANCE, LEAP_REST, leapSteps } from "./places";
import { assignHands } from "./split";

const CHANGE = 1.0; // a note that goes to the other hand
const STRETCH = 1.5; // a white key between those struck together that is more than five fingers cover
const SPAN = 0.18; // of thumb and little finger, m; ...
const OVERREACH = 0.01; // ... so far beyond that a key is lost, m
const LOST = 8.0; // a key that is struck and cannot be reached, or has no finger
const HELD = 2.0; // one that is held and has to be let go for want of a finger
const TOO_NEAR = 2.0; // a strike of a hand that is 5 cm too near to the other one
const NEAR_UNIT = 0.05; // m
const NEAR_MOST = 0.1; // m
const ARM_STEPS = 12; // control steps after its last note in which a hand is still where it was

// A hand's state: the least and the greatest place of its middle finger, as seen by a right hand, m, and
// when its last notes end, in control steps.
const LOW = 0;
const HIGH = 1;
const END = 2;

/**
 * Return a score with the hands that suit the simulated hands best.
 *
 * Notes that change hands lose their fingers. A piece for one hand stays with that hand.
 *
 * @param score the piece; where it has no hands, it is first shared as between a pianist's.
 * @param controlTimestep length of a control step, s.
 */
export function robotHands(score: Score, controlTimestep: number): Score {
  const shared = assignHands(score);
  if (!HANDS.every(([hand]) => shared.notes.some((note) => note.hand === hand))) return shared;
  const hands = searchHands(shared.notes, robotCosts(controlTimestep));
  const notes = shared.notes.map((note, index): Note => {
    const hand = hands[index]!;
    return note.hand === hand ? note : { ...note, hand, finger: UNKNOWN_FINGER };
  });
  return withNotes(shared, notes);
}

function robotCosts(controlTimestep: number): HandCosts {
  return {
    start: [-Infinity, Infinity, -Infinity],

    options: (struck) => inOrder([...lowestLeft(struck), written(struck)]),

    costsOf(chord, options) {
      const onset = chord.onset / controlTimestep;
      const end = Math.max(...chord.struck.map((note) => note.offset)) / controlTimestep;
      const before = written(chord.struck);
      const changed = options.map((share) => share.filter((left, at) => left !== before[at]).length);
      const parts = HANDS.map(([hand, sign]) =>
        options.map((option) => new Part(chord, option, hand, sign)),
      );
      return (states: HandStates, held: Share, option: number): Move => {
        let cost = CHANGE * changed[option]!;
        const after: [HandState, HandState] = [...states];
        for (const [hand] of HANDS) {
          const part = parts[hand]![option]!;
          if (part.takes.count === 0) continue;
          const [low, high, leap] = part.place(states[hand], onset);
          cost += part.grip(held) + leap;
          after[hand] = [low, high, end];
        }
        return { cost: cost + nearCost(after, onset), states: after };
      };
    },
  };
}

/** Return which notes the score gives to the left hand. */
function written(struck: readonly Note[]): Share {
  return struck.map((note) => note.hand === 1);
}

function nearCost([right, left]: HandStates, onset: number): number {
  if (onset - right[END] > ARM_STEPS || onset - left[END] > ARM_STEPS) return 0;
  // How far the right hand can be from the left one, whose places are seen in the mirror.
  const missing = clip(ARMS_APART - (right[HIGH] + left[HIGH]), 0, NEAR_MOST) / NEAR_UNIT;
  return TOO_NEAR * missing;
}

/** What one hand strikes; as seen from the right hand: the left hand's places are mirrored. */
class Part {
  readonly takes: Extent;
  private readonly held: readonly number[];
  /** Least and greatest place of the middle finger. */
  private readonly least: number;
  private readonly greatest: number;

  constructor(chord: Chord, option: Share, private readonly hand: 0 | 1, sign: number) {
    const place = (note: Note) => sign * KEY_Y[note.pitch - MIN_PITCH]!;
    this.takes = extentOf(chord.struck.map(place), option, hand);
    this.held = chord.held.map(place);
    const least = this.takes.high - 2 * KEY_SPACING;
    const greatest = this.takes.low + 2 * KEY_SPACING;
    const wide = least > greatest;
    this.least = wide ? (least + greatest) / 2 : least;
    this.greatest = wide ? (least + greatest) / 2 : greatest;
  }

  /** Cost of striking and holding keys together. */
  grip(held: Share): number {
    const { low, high, count } = this.takes;
    const width = Math.max(high - low, 0);
    const strikes =
      STRETCH * Math.max(width / KEY_SPACING - 4, 0) +
      LOST * clip((width - SPAN) / OVERREACH, 0, 2) +
      LOST * Math.max(count - FINGERS_PER_HAND, 0);
    const holds = extentOf(this.held, held, this.hand);
    if (holds.count === 0) return strikes;
    const whole = Math.max(high, holds.high) - Math.min(low, holds.low);
    const letGo =
      2 * clip((whole - SPAN) / OVERREACH, 0, 1) + Math.max(count + holds.count - FINGERS_PER_HAND, 0);
    return strikes + HELD * Math.min(letGo, 2);
  }

  /**
   * Return where the hand is to be, least and greatest place, and what it costs it to go there.
   *
   * Five fingers cover keys from two spacings below the middle finger to two above: a hand can be wherever
   * its keys are covered, and stays where it can.
   */
  place(state: HandState, onset: number): [low: number, high: number, leap: number] {
    const way = Math.max(this.least - state[HIGH], state[LOW] - this.greatest, 0);
    const rest = Math.max(onset - state[END], 0);
    const leap = way > LEAP_DISTANCE ? leapSteps(way, rest) : 0;
    if (rest > LEAP_REST || way > 0) return [this.least, this.greatest, leap];
    return [Math.max(this.least, state[LOW]), Math.min(this.greatest, state[HIGH]), leap];
  }
}
