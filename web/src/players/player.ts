import type { KeyEvent, Piece } from "../types";

/** What a control step has come to, without a simulation: (88) keys that sound at its end, and those that moved. */
export interface Placed {
  readonly sounding: Uint8Array;
  readonly events: KeyEvent[];
}

/** Who decides what the actuators are told. */
export interface Player {
  /** Take up a piece, from its beginning; the simulation is at rest. */
  prepare(piece: Piece): void;
  /**
   * Targets of the actuators, (nu) rad or m, for a control step.
   *
   * @param step The control step that is to be played, from 0; the simulation is as the one before left it.
   */
  controls(step: number): Float64Array;
  /** Put hands and keys where they are at the end of a control step; null to have it simulated by `controls`. */
  place?(step: number): Placed | null;
  /** Is told that somebody pulls, pushes, or lets actions come late or with noise, once or more often. */
  disturb?(): void;
}
