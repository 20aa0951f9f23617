import type { Piece } from "../types";

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
  /** Is told that somebody pulls, pushes, or lets actions come late or with noise, once or more often. */
  disturb?(): void;
}
