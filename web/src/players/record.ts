import { NUM_KEYS, type KeyEvent } from "../types";
import type { Simulation } from "../simulation/simulation";

/**
 * What was played in an episode, as in Python's `EpisodeRecord`.
 *
 * A key is pressed or let go when what it does at the end of a control step differs from the end of the step before;
 * the time is that of the physics step since which it has been so.
 */
export class EpisodeRecord {
  /** Strikes so far, ordered by control step: key and time, s. */
  readonly strikes: { readonly key: number; readonly time: number }[] = [];
  private readonly rows: Uint8Array;
  private readonly within: Uint8Array[];
  private readonly speeds: Float64Array[];
  private count = 0;

  /** Begin an empty record of an episode of at most so many control steps of a length, s. */
  constructor(
    private readonly simulation: Simulation,
    steps: number,
    private readonly controlTimestep: number,
  ) {
    const { substeps } = simulation.facts;
    this.rows = new Uint8Array(steps * NUM_KEYS);
    this.within = Array.from({ length: substeps }, () => new Uint8Array(NUM_KEYS));
    this.speeds = Array.from({ length: substeps }, () => new Float64Array(NUM_KEYS));
  }

  /** Control steps that are over. */
  get steps(): number {
    return this.count;
  }

  /** (steps, 88) which keys sounded at the end of each control step; a view. */
  played(): Uint8Array {
    return this.rows.subarray(0, this.count * NUM_KEYS);
  }

  /** Look at the keys after a physics step: all angles, rad, and speeds, rad/s. */
  look(substep: number, angles: Float64Array, speeds: Float64Array): void {
    this.simulation.soundingAt(angles, this.within[substep]!);
    this.speeds[substep]!.set(speeds);
  }

  /** Note down a control step whose physics steps were all looked at; return the keys that moved, in order. */
  addLooked(): KeyEvent[] {
    const now = this.within.at(-1)!;
    const before = this.last();
    const events: KeyEvent[] = [];
    for (let key = 0; key < NUM_KEYS; key++) {
      if (now[key] === (before?.[key] ?? 0)) continue;
      const substep = this.sinceWhen(key, now[key]!);
      const time = (this.count + (substep + 1) / this.within.length) * this.controlTimestep;
      events.push({ key, down: now[key] === 1, time, speed: Math.abs(this.speeds[substep]![key]!) });
    }
    return this.add(now, events);
  }

  /** Note down a control step: the keys that sound at its end, (88), and those that moved. */
  add(sounding: Uint8Array, events: KeyEvent[]): KeyEvent[] {
    events.sort((a, b) => a.time - b.time || a.key - b.key);
    for (const { key, time, down } of events) if (down) this.strikes.push({ key, time });
    this.rows.set(sounding, this.count * NUM_KEYS);
    this.count++;
    return events;
  }

  private last(): Uint8Array | null {
    return this.count === 0 ? null : this.rows.subarray((this.count - 1) * NUM_KEYS, this.count * NUM_KEYS);
  }

  /** First physics step from which on a key did what it does at the end of the control step. */
  private sinceWhen(key: number, now: number): number {
    let substep = this.within.length - 1;
    while (substep > 0 && this.within[substep - 1]![key] === now) substep--;
    return substep;
  }
}
