/** What has been played against what should have been, counting up control step by control step. */

import { NUM_KEYS, type Metrics, type PianoRoll } from "../types";
import { roundHalfEven } from "./numbers";

/** Distance from its target onset within which a strike hits, s. Source: `mir_eval.transcription`. */
const ONSET_TOLERANCE = 0.05;
/** Distances are rounded to ticks of 0.1 ms, so that 0.15 s - 0.1 s is 0.05 s. */
const TICKS_PER_S = 10_000;

/**
 * Metrics of an episode, over the control steps that were played; they are those of Python's `sb3_piano.metrics`.
 *
 * In each step, with h keys that sound and should, p that sound and d that should: precision is h / p, recall h / d
 * and F1 2 h / (p + d), each 1 where its denominator is 0; the mean is over steps. Of strikes and due onsets there are
 * as many pairs as possible, of one key and at most 0.05 s apart; onset F1 is twice their number over that of all
 * strikes and onsets, 1 if there is none.
 */
export class EpisodeMetrics {
  private steps = 0;
  private precision = 0;
  private recall = 0;
  private f1 = 0;
  private strikes = 0;
  /** Onsets that are due, by key: control step and time, in order. */
  private readonly dueOfKey: { readonly step: number; readonly time: number }[][] = perKey();
  private readonly struckOfKey: number[][] = perKey();

  constructor(private readonly roll: PianoRoll) {
    for (const { step, key, time } of roll.strikes) this.dueOfKey[key]!.push({ step, time });
  }

  /**
   * Take up a control step.
   *
   * @param sounding (88) 1 for keys that sound at its end.
   * @param strikes keys that went down in it and when, s; those of one key in order of time.
   */
  add(sounding: Uint8Array, strikes: readonly { readonly key: number; readonly time: number }[]): void {
    const first = this.steps * NUM_KEYS;
    let hit = 0;
    let played = 0;
    let due = 0;
    for (let key = 0; key < NUM_KEYS; key++) {
      const sounds = sounding[key]!;
      const should = this.roll.active[first + key]!;
      hit += sounds & should;
      played += sounds;
      due += should;
    }
    this.precision += ratio(hit, played);
    this.recall += ratio(hit, due);
    this.f1 += ratio(2 * hit, played + due);
    this.steps += 1;
    this.strikes += strikes.length;
    for (const { key, time } of strikes) this.struckOfKey[key]!.push(time);
  }

  /** Return the metrics so far, all 1 before the first step. */
  metrics(): Metrics {
    let due = 0;
    let hits = 0;
    this.dueOfKey.forEach((all, key) => {
      const begun = all.filter((one) => one.step < this.steps).map((one) => one.time);
      due += begun.length;
      hits += countPairs(begun, this.struckOfKey[key]!);
    });
    return {
      f1: ratio(this.f1, this.steps),
      precision: ratio(this.precision, this.steps),
      recall: ratio(this.recall, this.steps),
      onset_f1: ratio(2 * hits, this.strikes + due),
      onset_recall: ratio(hits, due),
    };
  }
}

/**
 * Return how many pairs of close times there can be; both are in order.
 *
 * Since all times reach equally far, it is never worse to take the earliest strike that is close to an onset.
 */
function countPairs(due: readonly number[], struck: readonly number[]): number {
  let pairs = 0;
  let next = 0;
  for (const time of due) {
    while (next < struck.length && struck[next]! < time && !areClose(struck[next]!, time)) next += 1;
    if (next < struck.length && areClose(struck[next]!, time)) {
      pairs += 1;
      next += 1;
    }
  }
  return pairs;
}

function areClose(one: number, other: number): boolean {
  return roundHalfEven(Math.abs(one - other) * TICKS_PER_S) / TICKS_PER_S <= ONSET_TOLERANCE;
}

function ratio(numerator: number, denominator: number): number {
  return denominator > 0 ? numerator / denominator : 1;
}

function perKey<T>(): T[][] {
  return Array.from({ length: NUM_KEYS }, () => []);
}
