/**
 * The search: which hand plays each note of a piece at the least cost, for any model of costs.
 *
 * A beam search over what is struck together. A *way* shares all notes up to some time between the hands;
 * the cheapest are followed. Time and memory grow with the number of onsets.
 */

import type { Note } from "../../types";
import { OVERLAP, struckTogether } from "./together";

/** Ways to share the piece between the hands that are followed at a time. */
const BEAM = 32;

/** For each note of some: whether the left hand has it. */
export type Share = readonly boolean[];

/** What a model has to know of a hand's past: three numbers, whose meaning is the model's. */
export type HandState = readonly [number, number, number];

/** States of the right and of the left hand. */
export type HandStates = readonly [HandState, HandState];

/** Notes that are struck together, and those that sound already. */
export interface Chord {
  /** When the first is struck, s. */
  readonly onset: number;
  /** In order of pitch. */
  readonly struck: readonly Note[];
  readonly held: readonly Note[];
}

/** Cost of one option after one way, and the states of both hands after it. */
export interface Move {
  readonly cost: number;
  readonly states: HandStates;
}

/** What hands cost. */
export interface HandCosts {
  /** State of a hand that has not played yet. */
  readonly start: HandState;
  /** Return the ways to share notes that are struck together, in order. */
  options(struck: readonly Note[]): Share[];
  /**
   * Return the function that tells what an option costs after a way.
   *
   * @param chord what is struck.
   * @param options how it may be shared.
   */
  costsOf(
    chord: Chord,
    options: readonly Share[],
  ): (states: HandStates, held: Share, option: number) => Move;
}

interface Way {
  readonly cost: number;
  readonly states: HandStates;
  /** Which of the sounding notes the left hand holds. */
  readonly held: Share;
  /** The way up to the chord before, and how the notes of this one are shared. */
  readonly before: Way | null;
  readonly group: readonly number[];
  readonly option: Share;
}

/** Return the hand, 0 right or 1 left, of each note; notes are sorted by onset. */
export function searchHands(notes: readonly Note[], model: HandCosts): (0 | 1)[] {
  const start = { cost: 0, states: [model.start, model.start] as const, held: [] };
  let ways: Way[] = [{ ...start, before: null, group: [], option: [] }];
  let sounding: number[] = [];
  for (const together of struckTogether(notes)) {
    const group = [...together].sort((a, b) => notes[a]!.pitch - notes[b]!.pitch);
    const onset = notes[together[0]!]!.onset;
    // A key that is struck again is held no longer, whatever note has begun on it.
    const again = new Set(group.map((index) => notes[index]!.pitch));
    const stays = sounding.map((index) => notes[index]!.offset > onset + OVERLAP && !again.has(notes[index]!.pitch));
    sounding = sounding.filter((_, place) => stays[place]);
    const struck = group.map((index) => notes[index]!);
    const options = model.options(struck);
    const chord = { onset, struck, held: sounding.map((index) => notes[index]!) };
    const costs = model.costsOf(chord, options);
    const lasting = lastOfEachKey(group, notes);
    const next = ways.flatMap((way) => {
      const held = way.held.filter((_, place) => stays[place]);
      return options.map((option, at): Way => {
        const { cost, states } = costs(way.states, held, at);
        const holds = [...held, ...lasting.map((place) => option[place]!)];
        return { cost: way.cost + cost, states, held: holds, before: way, group, option };
      });
    });
    // Sorting is stable: of equals, the first ways and options come first.
    ways = distinct(next.sort((a, b) => a.cost - b.cost).slice(0, 2 * BEAM));
    sounding = [...sounding, ...lasting.map((place) => group[place]!)];
  }
  const hands = new Array<0 | 1>(notes.length).fill(0);
  for (let way: Way | null = ways[0]!; way; way = way.before) {
    way.group.forEach((index, place) => (hands[index] = way!.option[place] ? 1 : 0));
  }
  return hands;
}

/** Return the places of the notes of a chord that hold its keys: of several, the longest. */
function lastOfEachKey(group: readonly number[], notes: readonly Note[]): number[] {
  const end = (place: number) => notes[group[place]!]!.offset;
  const byEnd = [...group.keys()].sort((a, b) => end(a) - end(b));
  return [...new Map(byEnd.map((place) => [notes[group[place]!]!.pitch, place])).values()].sort((a, b) => a - b);
}

/** Return the first ways, without those that will cost the same from here on as one before. */
function distinct(ways: readonly Way[]): Way[] {
  const kept: Way[] = [];
  for (const way of ways) {
    if (!kept.some((other) => areAlike(way, other))) kept.push(way);
    if (kept.length === BEAM) break;
  }
  return kept;
}

function areAlike(one: Way, other: Way): boolean {
  return (
    [0, 1].every((hand) => one.states[hand]!.every((x, at) => x === other.states[hand]![at])) &&
    one.held.every((left, place) => left === other.held[place])
  );
}

/**
 * Return the ways to share notes, in order of pitch, in which the left hand takes the lowest.
 *
 * A key is struck by one hand, however many notes strike it.
 */
export function lowestLeft(struck: readonly Note[]): Share[] {
  const firsts = [...struck.keys()].filter((place) => struck[place]!.pitch !== struck[place - 1]?.pitch);
  return [...firsts, struck.length].map((left) => struck.map((_, place) => place < left));
}

/** Return shares without repetition, in order: the right hand comes first. */
export function inOrder(shares: readonly Share[]): Share[] {
  const name = (share: Share) => share.map(Number).join("");
  const byName = new Map(shares.map((share) => [name(share), share]));
  return [...byName.keys()].sort().map((key) => byName.get(key)!);
}

/** Keys that a hand strikes or holds. */
export interface Extent {
  readonly low: number;
  readonly high: number;
  readonly count: number;
}

/** Return the least and the greatest place of what a hand has; infinity and less if it has nothing. */
export function extentOf(places: readonly number[], share: Share, hand: number): Extent {
  let low = Infinity;
  let high = -Infinity;
  let count = 0;
  places.forEach((place, index) => {
    if (Number(share[index]) !== hand) return;
    low = Math.min(low, place);
    high = Math.max(high, place);
    count += 1;
  });
  return { low, high, count };
}
