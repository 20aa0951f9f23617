import { NUM_KEYS, type KeyEvent, type Metrics, type Piece, type SceneState, type Session } from "../types";

/** What Python's `sb3_piano.viewing.report.replay` writes of a performance. */
export interface Recording {
  readonly bodyNames: readonly string[];
  /** (bodies, T + 1, 7) positions in units of `resolution` m and quaternions w x y z in 1/32767, at all T + 1 states. */
  readonly poses: Int16Array;
  readonly resolution: number;
  /** (T, 88) keys that sounded at the end of each control step. */
  readonly sounding: Uint8Array;
  readonly piece: Piece;
  readonly metrics: Metrics;
}

const NUMBERS = 7;

/** A session in which everything has happened already: it shows what was recorded, control step by control step. */
export class RecordedSession implements Session {
  readonly player = "recorded";
  readonly piece: Piece;
  readonly state: SceneState;
  stepsPlayed = 0;
  noise = 0;
  latency = 0;
  private readonly steps: number;

  constructor(private readonly recording: Recording) {
    const { bodyNames, piece, sounding } = recording;
    this.piece = piece;
    this.steps = sounding.length / NUM_KEYS;
    this.state = {
      keyState: new Float64Array(NUM_KEYS),
      sounding: new Uint8Array(NUM_KEYS),
      bodyPositions: new Float64Array(3 * bodyNames.length),
      bodyQuaternions: new Float64Array(4 * bodyNames.length),
      bodyNames,
    };
    this.show();
  }

  get finished(): boolean {
    return this.stepsPlayed >= this.steps;
  }

  step(): readonly KeyEvent[] {
    if (this.finished) return [];
    const before = this.state.sounding.slice();
    this.stepsPlayed++;
    this.show();
    const time = this.stepsPlayed * this.piece.roll.controlTimestep;
    return [...this.state.sounding.keys()]
      .filter((key) => this.state.sounding[key] !== before[key])
      .map((key) => ({ key, down: this.state.sounding[key] === 1, time, speed: 0 }));
  }

  restart(): void {
    this.stepsPlayed = 0;
    this.show();
  }

  metrics(): Metrics {
    return this.recording.metrics;
  }

  played(): Uint8Array {
    return this.recording.sounding.subarray(0, this.stepsPlayed * NUM_KEYS);
  }

  pull(): void {
    // What is recorded cannot be changed.
  }

  pushKey(): void {
    // Nor can this.
  }

  private show(): void {
    const { poses, resolution, sounding } = this.recording;
    const { bodyPositions, bodyQuaternions, bodyNames } = this.state;
    for (let body = 0; body < bodyNames.length; body++) {
      const at = (body * (this.steps + 1) + this.stepsPlayed) * NUMBERS;
      for (let i = 0; i < 3; i++) bodyPositions[3 * body + i] = poses[at + i]! * resolution;
      for (let i = 0; i < 4; i++) bodyQuaternions[4 * body + i] = poses[at + 3 + i]! / 32767;
    }
    const row = (this.stepsPlayed - 1) * NUM_KEYS;
    if (row < 0) this.state.sounding.fill(0);
    else this.state.sounding.set(sounding.subarray(row, row + NUM_KEYS));
  }
}
