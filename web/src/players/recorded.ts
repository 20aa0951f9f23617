import type { Simulation } from "../simulation/simulation";
import { floats, type Tensors } from "../tensors";
import { InputError, type Piece } from "../types";
import { ActionMap } from "./actions";
import type { Player } from "./player";

/**
 * The actions of a performance that Python recorded, played once more.
 *
 * Contacts let a difference in the last bit, as there is between builds of MuJoCo, grow to a centimetre within two
 * seconds. So hands and keys are put where they were every half a second, for as long as nobody interferes: then the
 * actions go on alone.
 */
export class Recorded implements Player {
  private readonly actions: Float32Array;
  private readonly states: Float32Array;
  private readonly stateEvery: number;
  private readonly map: ActionMap;
  private disturbed = false;

  constructor(
    file: Tensors,
    private readonly simulation: Simulation,
  ) {
    this.actions = floats(file, "actions");
    this.states = floats(file, "states");
    this.stateEvery = Number(file.metadata["state_every"]);
    this.map = new ActionMap(simulation.facts);
  }

  /** @throws InputError If the recording is of another piece. */
  prepare(piece: Piece): void {
    this.disturbed = false;
    checkLength(piece, this.actions.length / this.simulation.facts.counts.nu, "recording");
  }

  disturb(): void {
    this.disturbed = true;
  }

  controls(step: number): Float64Array {
    const { nu, nq, nv } = this.simulation.facts.counts;
    if (!this.disturbed && step > 0 && step % this.stateEvery === 0) {
      const first = (step / this.stateEvery) * (nq + nv);
      const velocities = first + nq;
      this.simulation.place(this.states.subarray(first, velocities), this.states.subarray(velocities, velocities + nv));
    }
    return this.map.controls(this.actions.subarray(step * nu, (step + 1) * nu));
  }
}

/** @throws InputError If a file has another number of control steps than the piece. */
export function checkLength(piece: Piece, steps: number, what: string): void {
  if (steps !== piece.roll.steps) {
    throw new InputError(
      `The ${what} has ${steps} control steps and “${piece.score.title}” ${piece.roll.steps}: expected the piece ` +
        "that it was made for.",
    );
  }
}
