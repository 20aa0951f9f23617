/**
 * The ergonomic model: fingers that are the least effort for a pianist's hand.
 *
 * The costs look at up to three onsets in succession. They are those of patterns, which say nothing of when
 * and in which octave they are played: music that repeats itself is worked out once.
 *
 * Keys are pitches in the right hand's view: the left hand's are mirrored about D, after which its part looks
 * like one of the right hand.
 */

import { UNKNOWN_FINGER, type Note } from "../../types";
import { FINGERS_PER_HAND, THUMB, isBlack } from "../constants";
import { clip } from "../numbers";
import { CostTables, WEIGHTS, pairAt, type PairTable } from "./cost";
import { searchFingers, type FingerCosts, type Onset } from "./finger_search";
import { Memo, patternOf, playable, statesOf, type Pattern, type Shape } from "./patterns";
import { OVERLAP, struckTogether } from "./together";

/** The widest grip of a hand, in semitones; keys held farther away are let go (Balliauw et al. 2017). */
const WIDEST = 16;
const MIRROR = 2 * 62; // sum of a pitch and its mirror image: D4 is its own
const SLOWEST = 0.3; // between these ...
const FASTEST = 2.0; // ... the time there is weighs the costs of movement
const OCTAVE = 12;

/**
 * Find the fingering of one hand's notes, sorted by onset, that costs the least.
 *
 * Notes that have a finger keep it. When a hand cannot hold all that it should (too many keys, too wide, or
 * no way to reach the next ones), it lets go of the key held longest first.
 *
 * @returns for each note, 0 (thumb) to 4, or -1 if no finger is left for it.
 */
export function fingerHand(notes: readonly Note[], hand: 0 | 1): number[] {
  const fingers = new Array<number>(notes.length).fill(UNKNOWN_FINGER);
  for (const [strike, finger] of searchFingers(chordsOf(notes, hand), new Ergonomic(), 2)) {
    for (const index of strike.notes) fingers[index] = finger;
  }
  return fingers;
}

/** A key that is struck once; notes that double each other share one. */
interface Strike {
  readonly key: number;
  readonly onset: number;
  readonly offset: number;
  /** Indices of its notes in the part. */
  readonly notes: readonly number[];
  /** Finger that plays it, 0 (thumb) to 4, if that is known beforehand, else -1. */
  readonly label: number;
}

/** Return what a hand strikes together, in order of keys, as far as there are fingers for it. */
function chordsOf(notes: readonly Note[], hand: 0 | 1): Strike[][] {
  return struckTogether(notes).map((chord) => {
    const strikes = new Map<number, Strike>();
    for (const index of chord) {
      const { pitch, onset, offset, finger } = notes[index]!;
      const key = hand === 0 ? pitch : MIRROR - pitch;
      const label = finger === UNKNOWN_FINGER ? finger : finger % FINGERS_PER_HAND;
      const before = strikes.get(key);
      strikes.set(key, {
        key,
        onset: before ? before.onset : onset,
        offset: before ? Math.max(before.offset, offset) : offset,
        notes: before ? [...before.notes, index] : [index],
        label: before && before.label !== UNKNOWN_FINGER ? before.label : label,
      });
    }
    const struck = [...strikes.values()].sort((a, b) => a.key - b.key);
    return playable(struckShape(struck)).map((place) => struck[place]!);
  });
}

function struckShape(struck: readonly Strike[]): Shape {
  return struck.map((strike) => [true, strike.label] as const);
}

/** Keys that are down, from low to high. */
interface Slice extends Onset<Strike> {
  readonly pattern: Pattern;
  readonly onset: number;
  readonly release: number;
}

/** Costs of the fingers of a pianist's hand. */
class Ergonomic implements FingerCosts<Strike, Slice> {
  held(down: readonly Strike[], struck: readonly Strike[]): Strike[] {
    const onset = Math.min(...struck.map((strike) => strike.onset));
    const again = new Set(struck.map((strike) => strike.key));
    const [low, high] = [struck[0]!.key, struck.at(-1)!.key];
    let held = down
      .filter((one) => one.offset > onset + OVERLAP && !again.has(one.key))
      .filter((one) => Math.max(high, one.key) - Math.min(low, one.key) <= WIDEST)
      .sort((a, b) => a.onset - b.onset || a.key - b.key);
    for (const strike of [...held]) {
      // The one held longest first.
      const keys = [...held.map((other) => other.key), low, high];
      const crowded = held.length + struck.length > FINGERS_PER_HAND;
      if (crowded || Math.max(...keys) - Math.min(...keys) > WIDEST) {
        held = held.filter((other) => other !== strike);
      }
    }
    return held;
  }

  lay(_path: readonly Slice[], held: readonly Strike[], struck: readonly Strike[]): Slice {
    const down = [...held, ...struck].sort((a, b) => a.key - b.key);
    const low = down[0]!.key;
    const pattern = patternOf(
      low % OCTAVE,
      down.map((strike) => strike.key - low),
      down.map((strike) => [!held.includes(strike), strike.label] as const),
      // Fingers leave the order of the keys only where labels give them no other way.
      statesOf(struckShape(struck), true).length > 0,
    );
    const onset = Math.min(...struck.map((strike) => strike.onset));
    const release = Math.max(...down.map((strike) => strike.offset));
    return { down, states: pattern.states, pattern, onset, release };
  }

  costs(path: readonly Slice[], onset: Slice): Float64Array {
    const own = ownCosts(onset.pattern);
    const last = path.at(-1);
    if (!last) return own;
    const rise = lowest(onset) - lowest(last);
    const { moves, colours } = stepCosts(last.pattern, onset.pattern, rise);
    const calm = calmOf(last, onset);
    const speed = speedOf(onset.onset - last.onset) * calm;
    const columns = own.length;
    const pairs = colours.map((colour, at) => colour + speed * moves[at]! + own[at % columns]!);
    const first = path.at(-2);
    if (!first) return pairs;
    const rises = [lowest(last) - lowest(first), lowest(onset) - lowest(first)] as const;
    const { shifts, triples } = shiftCosts([first.pattern, last.pattern, onset.pattern], rises);
    const weight = speedOf((onset.onset - first.onset) / 2) * calmOf(first, last) * calm;
    return shifts.map((shift, at) => weight * shift + triples[at]! + pairs[at % pairs.length]!);
  }

  keep(onset: Slice, kept: readonly number[]): Slice {
    return { ...onset, states: kept.map((state) => onset.states[state]!) };
  }
}

function lowest(slice: Slice): number {
  return slice.down[0]!.key;
}

function speedOf(time: number): number {
  return clip(Math.sqrt(WEIGHTS.pace / time), SLOWEST, FASTEST);
}

function calmOf(first: Slice, second: Slice): number {
  return Math.exp(-Math.max(second.onset - first.release, 0) / WEIGHTS.rest);
}

// Costs for all states of a pattern, and of going from one to the next.

let madeTables: CostTables | undefined;
const ownMemo = new Memo<Float64Array>();
const stepMemo = new Memo<StepCosts>();
const shiftMemo = new Memo<ShiftCosts>(2048);

/** Return the tables, which take a moment to make, and are not needed by pieces with fingers. */
function tables(): CostTables {
  madeTables ??= new CostTables();
  return madeTables;
}

/**
 * Return what each state costs by itself; infinite if a held key is out of reach.
 *
 * Each struck key counts with its finger, and each pair of keys of which one is struck at least with its
 * grip, in sum over the average number of partners.
 */
function ownCosts(pattern: Pattern): Float64Array {
  const { name, pitchClass, intervals, shape, states } = pattern;
  return ownMemo.get(name, () =>
    Float64Array.from(states, (fingers) => {
      let cost = 0;
      let pairs = 0;
      shape.forEach(([struck], place) => {
        const key = (pitchClass + intervals[place]!) % OCTAVE;
        if (struck) cost += tables().single(isBlack(key), fingers[place]!);
        for (let above = place + 1; above < shape.length; above++) {
          const interval = intervals[above]! - intervals[place]!;
          const at = pairAt(key, interval, fingers[place]!, fingers[above]!);
          const otherStruck = shape[above]![0];
          if (struck || otherStruck) pairs += tables().grips[at]!;
          if (struck !== otherStruck && tables().far[at]) pairs = Infinity;
        }
      });
      return cost + pairs / Math.max(shape.length - 1, 1);
    }),
  );
}

/** What each step costs that depends on time, and what does not: (states of the first, of the second). */
interface StepCosts {
  readonly moves: Float64Array;
  /** Infinite where a finger would have to leave a key that is held. */
  readonly colours: Float64Array;
}

/** Return the costs of going from one pattern to the next; `rise` is from the lowest key to the next lowest. */
function stepCosts(first: Pattern, second: Pattern, rise: number): StepCosts {
  return stepMemo.get(`${first.name} ${second.name} ${rise}`, () => {
    const kept = new Map<number, number>();
    second.shape.forEach(([struck], place) => {
      if (!struck) kept.set(first.intervals.indexOf(second.intervals[place]! + rise), place);
    });
    const left = Array.from(first.intervals.keys()).filter((place) => !kept.has(place));
    const chord = left.length > 1 || second.struck.length > 1;
    const { moves, chordMoves, colours } = tables();
    const colour = meanPairs(colours, first, second, rise, left);
    first.states.forEach((one, row) => {
      second.states.forEach((other, column) => {
        for (const [place, later] of kept) {
          if (one[place] !== other[later]) colour[row * second.states.length + column] = Infinity;
        }
      });
    });
    return { moves: meanPairs(chord ? chordMoves : moves, first, second, rise, left), colours: colour };
  });
}

/** What changes of position cost that depends on time, and what does not: (first, second, third) states. */
interface ShiftCosts {
  readonly shifts: Float64Array;
  readonly triples: Float64Array;
}

/**
 * Return the costs of three patterns in succession.
 *
 * The second pattern counts if all three strike a single key. `rises` are from the first lowest key to the
 * others.
 */
function shiftCosts(
  patterns: readonly [Pattern, Pattern, Pattern],
  rises: readonly [number, number],
): ShiftCosts {
  const [first, second, third] = patterns;
  const name = `${first.name} ${second.name} ${third.name} ${rises.join()}`;
  return shiftMemo.get(name, () => {
    const half = meanPairs(tables().shifts, first, third, rises[1], first.struck);
    const shifts = new Float64Array(first.states.length * second.states.length * third.states.length);
    const triples = new Float64Array(shifts.length);
    const single = patterns.every((pattern) => pattern.struck.length === 1);
    const [p, q, r] = patterns.map((pattern) => pattern.struck[0]!) as [number, number, number];
    const one = first.intervals[p]!;
    const two = second.intervals[q]! + rises[0];
    const three = third.intervals[r]! + rises[1];
    const inLine = single && ((one < two && two < three) || (one > two && two > three));
    const full = inLine ? meanPairs(tables().fullShifts, first, third, rises[1], first.struck) : half;
    let at = 0;
    first.states.forEach((fingers, row) => {
      for (const middle of second.states) {
        const table = inLine && middle[q] === THUMB ? full : half;
        third.states.forEach((last, column) => {
          const shift = table[row * third.states.length + column]!;
          shifts[at] = single ? shift : WEIGHTS.chordShift * shift;
          triples[at] = single ? tables().triple(fingers[p]!, middle[q]!, last[r]!) : 0;
          at += 1;
        });
      }
    });
    return { shifts, triples };
  });
}

/**
 * Sum the costs of keys at `places` with those struck later: (first, second) states.
 *
 * The sum is over the larger number of keys.
 */
function meanPairs(
  table: PairTable,
  first: Pattern,
  second: Pattern,
  rise: number,
  places: readonly number[],
): Float64Array {
  const mean = new Float64Array(first.states.length * second.states.length);
  const later = second.struck;
  if (places.length === 0 || later.length === 0) return mean;
  const count = Math.max(places.length, later.length);
  let at = 0;
  for (const one of first.states) {
    for (const other of second.states) {
      let sum = 0;
      for (const place of places) {
        const key = first.intervals[place]!;
        const pitchClass = (first.pitchClass + key) % OCTAVE;
        for (const next of later) {
          const interval = second.intervals[next]! + rise - key;
          sum += table[pairAt(pitchClass, interval, one[place]!, other[next]!)]!;
        }
      }
      mean[at] = sum / count;
      at += 1;
    }
  }
  return mean;
}
