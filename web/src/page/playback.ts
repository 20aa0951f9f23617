import { NUM_KEYS, type KeyEvent, type Session } from "../types";
import { Pose } from "../view/pose";
import type { Moment } from "../view/scene";

/** Longest time between two pictures that is caught up with, s: after a pause of the browser the piece goes on. */
const LONGEST_GAP = 0.1;

/** What is called around each control step. */
export interface StepHooks {
  before(): void;
  /** @param delay For each event: s of real time from now at which it is on show. */
  after(events: readonly KeyEvent[], delay: (event: KeyEvent) => number): void;
}

/**
 * The clock between simulated and real time.
 *
 * Control steps are simulated as soon as the time on show enters them; what is on show lies between the poses before
 * and after the last step, so that motion is smooth at any tempo.
 */
export class Playback {
  playing = false;
  /** Simulated time in a second of real time. */
  tempo = 1;
  /** Time on show, s since the start of the episode. */
  shown = 0;
  private readonly from: Pose;
  private readonly to: Pose;
  private readonly sounding = new Uint8Array(NUM_KEYS);
  private pending: KeyEvent[] = [];
  /** Time of a control step, s: a report may be of another one than the page's. */
  private readonly timestep: number;

  constructor(
    readonly session: Session,
    private readonly hooks: StepHooks,
  ) {
    this.timestep = session.piece.roll.controlTimestep;
    this.from = new Pose(session.state);
    this.to = new Pose(session.state);
  }

  /** Simulated time, s. */
  get simulated(): number {
    return this.session.stepsPlayed * this.timestep;
  }

  /** Go on by some real time, s, if it plays; stop at the end. */
  tick(elapsed: number): void {
    if (!this.playing) return;
    this.shown += Math.min(elapsed, LONGEST_GAP) * this.tempo;
    while (this.shown > this.simulated && !this.session.finished) this.step();
    if (this.shown >= this.simulated) {
      this.shown = this.simulated;
      this.playing = !this.session.finished;
    }
    this.settle();
  }

  /** Play so many control steps at once, or fewer if the piece ends, and show their end. */
  advance(steps: number): void {
    for (let i = 0; i < steps && !this.session.finished; i++) {
      this.shown = this.simulated + this.timestep;
      this.step();
    }
    this.shown = this.simulated;
    this.settle();
  }

  /** Begin again. */
  restart(): void {
    this.session.restart();
    this.shown = 0;
    this.pending = [];
    this.sounding.fill(0);
    this.from.read(this.session.state);
    this.to.read(this.session.state);
  }

  /** What is on show. */
  moment(): Moment {
    const share = 1 - (this.simulated - this.shown) / this.timestep;
    return { time: this.shown, from: this.from, to: this.to, share, sounding: this.sounding };
  }

  private step(): void {
    this.hooks.before();
    const events = this.session.step();
    this.from.copy(this.to);
    this.to.read(this.session.state);
    this.pending.push(...events);
    this.hooks.after(events, (event) => (event.time - this.shown) / this.tempo);
  }

  /** Let the keys sound that have begun to until the time on show. */
  private settle(): void {
    const later = this.pending.findIndex((event) => event.time > this.shown + 1e-9);
    const now = later < 0 ? this.pending : this.pending.slice(0, later);
    for (const event of now) this.sounding[event.key] = event.down ? 1 : 0;
    this.pending = later < 0 ? [] : this.pending.slice(later);
  }
}
