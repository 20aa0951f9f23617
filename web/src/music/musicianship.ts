/** Loudness, chords, timing and legato of a performance, by the definitions of Python's `sb3_piano.metrics.musicianship`. */

import { MIN_PITCH, NUM_KEYS, type KeyEvent, type Piece } from "../types";
import { velocityOf } from "./dynamics";
import { roundHalfEven } from "./numbers";
import { makeScore } from "./score";

/** Distance within which a strike hits a note, s, and ticks to which it is rounded. */
const ONSET_TOLERANCE = 0.05;
const TICKS_PER_S = 10_000;
/** Greatest distance of rescaled velocities, as a share of the range of the due ones. */
const VELOCITY_TOLERANCE = 0.1;
/** Notes due within this time of the first of them are a chord, s. */
const TOGETHER = 0.03;
/** Notes touch if the second is due within this time of the end of the first, s. */
const TOUCHING = 0.02;
const MIDDLE_C = 60;
const MS = 1000;

/** Names are Python's; NaN stands for a number without a value. */
export interface Musicianship {
  readonly note_velocity_f1: number;
  readonly velocity_correlation: number;
  readonly chord_spread_ms: number;
  readonly melody_lead_ms: number;
  readonly onset_error_mean_right_ms: number;
  readonly onset_error_std_right_ms: number;
  readonly onset_error_mean_left_ms: number;
  readonly onset_error_std_left_ms: number;
  readonly duration_ratio: number;
  readonly legato_overlap_ms: number;
}

interface Sounded {
  readonly key: number;
  readonly onset: number;
  readonly offset: number;
  readonly velocity: number;
  readonly hand: 0 | 1;
}

/** A due note, and the strike that hits it. */
type Hit = readonly [due: Sounded, played: Sounded];

/**
 * Compare the control steps that were played with the score.
 *
 * @param events all keys that moved in them.
 * @returns null where the piece's score is not known.
 */
export function musicianship({ score, roll, lead }: Piece, events: readonly KeyEvent[], steps: number): Musicianship | null {
  if (lead === null) return null;
  const end = steps * roll.controlTimestep;
  const begun = score.notes
    .filter((note) => note.onset < end - lead)
    .map((note) => ({ ...note, offset: Math.min(note.offset, end - lead) }));
  // In their order, which the cut may have changed.
  const written = makeScore(begun, [], "").notes.map(({ pitch, onset, offset, velocity, hand }) => ({
    key: pitch - MIN_PITCH,
    onset: onset + lead,
    offset: offset + lead,
    velocity,
    hand: hand ?? (pitch < MIDDLE_C ? 1 : 0),
  }));
  const [due, played] = [apart(written), apart(strikesOf(events, end))];
  const hits = match(due, played);
  const late = (hand: 0 | 1): number[] =>
    hits.filter(([note]) => note.hand === hand).map(([note, strike]) => strike.onset - note.onset);
  const velocities = hits.map((hit) => hit.map((one) => one.velocity)) as [number, number][];
  const chords = chordsOf(hits);
  return {
    note_velocity_f1: velocityF1(due, played, velocities),
    velocity_correlation: correlation(velocities),
    chord_spread_ms: MS * mean(chords.map((chord) => range(chord.map(([, { onset }]) => onset)))),
    melody_lead_ms: MS * mean(chords.map(leadOf)),
    onset_error_mean_right_ms: MS * mean(late(0)),
    onset_error_std_right_ms: MS * deviation(late(0)),
    onset_error_mean_left_ms: MS * mean(late(1)),
    onset_error_std_left_ms: MS * deviation(late(1)),
    duration_ratio: median(hits.map(([note, strike]) => (strike.offset - strike.onset) / (note.offset - note.onset))),
    legato_overlap_ms: MS * median(overlaps(hits)),
  };
}

/** The notes of keys that moved; those still down end with the last control step. */
function strikesOf(events: readonly KeyEvent[], end: number): Sounded[] {
  const down = new Map<number, KeyEvent>();
  const notes: Sounded[] = [];
  const close = ({ key, time, speed }: KeyEvent, offset: number): void => {
    notes.push({ key, onset: time, offset, velocity: velocityOf(speed, key), hand: 0 });
  };
  for (const event of events) {
    const before = down.get(event.key);
    if (before !== undefined) close(before, event.time);
    if (event.down) down.set(event.key, event);
    else down.delete(event.key);
  }
  for (const event of down.values()) close(event, end);
  return notes.sort((a, b) => a.onset - b.onset || a.key - b.key);
}

/** Notes as a key can play them: each ends no later than its key is struck again. */
function apart(notes: readonly Sounded[]): Sounded[] {
  const next = new Array<number>(NUM_KEYS).fill(Infinity);
  const cut: Sounded[] = [];
  for (const note of [...notes].reverse()) {
    const offset = Math.min(note.offset, next[note.key]!);
    next[note.key] = note.onset;
    if (offset > note.onset) cut.push({ ...note, offset });
  }
  return cut.reverse();
}

/** As many pairs as possible of notes and strikes, with the least sum of distances; earlier notes are preferred. */
function match(due: readonly Sounded[], played: readonly Sounded[]): Hit[] {
  const hits: Hit[] = [];
  for (let key = 0; key < NUM_KEYS; key++) {
    const of = (notes: readonly Sounded[]): Sounded[] => notes.filter((note) => note.key === key);
    hits.push(...matchKey(of(due), of(played)));
  }
  const order = new Map(due.map((note, i) => [note, i]));
  return hits.sort(([a], [b]) => order.get(a)! - order.get(b)!);
}

/** By dynamic programming over the notes and strikes of a key, in order of time. */
function matchKey(due: readonly Sounded[], played: readonly Sounded[]): Hit[] {
  const width = played.length + 1;
  // A pair more outweighs all distances together.
  const pair = due.length * (ONSET_TOLERANCE * TICKS_PER_S + 1) + 1;
  const best = new Float64Array((due.length + 1) * width);
  due.forEach((note, i) => {
    played.forEach((strike, j) => {
      const ticks = roundHalfEven(Math.abs(note.onset - strike.onset) * TICKS_PER_S);
      const worth = ticks / TICKS_PER_S <= ONSET_TOLERANCE ? pair - ticks + best[i * width + j]! : 0;
      best[(i + 1) * width + j + 1] = Math.max(best[i * width + j + 1]!, best[(i + 1) * width + j]!, worth);
    });
  });
  const hits: Hit[] = [];
  let [i, j] = [due.length, played.length];
  while (i > 0 && j > 0) {
    const here = best[i * width + j];
    if (here === best[(i - 1) * width + j]) i--;
    else if (here === best[i * width + j - 1]) j--;
    else hits.push([due[--i]!, played[--j]!]);
  }
  return hits;
}

/** F1 of the hits whose velocities agree: due ones scaled to 0 to 1, played ones fitted to them by least squares. */
function velocityF1(due: readonly Sounded[], played: readonly Sounded[], hits: readonly [number, number][]): number {
  const all = due.map((note) => note.velocity);
  if (due.length === 0 || range(all) === 0) return NaN;
  const scaled = hits.map(([velocity]) => (velocity - Math.min(...all)) / range(all));
  const struck = hits.map(([, velocity]) => velocity);
  const slope = range(struck) > 0 ? covariance(scaled, struck) / covariance(struck, struck) : 0;
  const start = mean(scaled) - slope * mean(struck);
  const equal = scaled.filter((value, i) => Math.abs(start + slope * struck[i]! - value) < VELOCITY_TOLERANCE);
  return (2 * equal.length) / (due.length + played.length);
}

function correlation(pairs: readonly [number, number][]): number {
  const [a, b] = [0, 1].map((side) => pairs.map((pair) => pair[side]!)) as [number[], number[]];
  if (pairs.length < 2 || range(a) === 0 || range(b) === 0) return NaN;
  return covariance(a, b) / Math.sqrt(covariance(a, a) * covariance(b, b));
}

/** The hits of each chord that has two keys or more. */
function chordsOf(hits: readonly Hit[]): Hit[][] {
  const chords: Hit[][] = [];
  for (const hit of hits) {
    const last = chords.at(-1);
    if (last !== undefined && hit[0].onset <= last[0]![0].onset + TOGETHER) last.push(hit);
    else chords.push([hit]);
  }
  return chords.filter((chord) => range(chord.map(([{ key }]) => key)) > 0);
}

/** Time by which the highest note of a chord is struck before the mean of the others, s. */
function leadOf(chord: readonly Hit[]): number {
  const top = Math.max(...chord.map(([{ key }]) => key));
  const times = (isTop: boolean): number[] =>
    chord.filter(([{ key }]) => (key === top) === isTop).map(([, { onset }]) => onset);
  return mean(times(false)) - mean(times(true));
}

/** Release less next strike of notes of a hand that touch in the score, s; the next is the nearest in pitch. */
function overlaps(hits: readonly Hit[]): number[] {
  const found: number[] = [];
  for (const [note, strike] of hits) {
    let [nearest, next]: [number, Sounded | null] = [Infinity, null];
    for (const [after, its] of hits) {
      const touches = Math.abs(after.onset - note.offset) <= TOUCHING && after.onset > note.onset;
      const away = Math.abs(after.key - note.key);
      if (touches && after.hand === note.hand && away > 0 && away < nearest) [nearest, next] = [away, its];
    }
    if (next !== null) found.push(strike.offset - next.onset);
  }
  return found;
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

function covariance(a: readonly number[], b: readonly number[]): number {
  const [one, other] = [mean(a), mean(b)];
  return mean(a.map((value, i) => (value - one) * (b[i]! - other)));
}

function deviation(values: readonly number[]): number {
  return Math.sqrt(covariance(values, values));
}

function range(values: readonly number[]): number {
  return Math.max(...values) - Math.min(...values);
}

function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  const middle = (sorted.length - 1) / 2;
  return (sorted[Math.floor(middle)]! + sorted[Math.ceil(middle)]!) / 2;
}
