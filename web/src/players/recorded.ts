import { floats, type Tensors } from "../tensors";
import { InputError, type Piece } from "../types";
import type { Player } from "./player";

/** Commands of a performance that Python recorded, played once more whatever happens. */
export class Recorded implements Player {
  private readonly recorded: Float32Array;

  /** @param actuators How many actuators there are. */
  constructor(
    file: Tensors,
    private readonly actuators: number,
  ) {
    this.recorded = floats(file, "controls");
  }

  /** @throws InputError If the recording is of another piece. */
  prepare(piece: Piece): void {
    checkLength(piece, this.recorded.length / this.actuators, "recording");
  }

  controls(step: number): Float64Array {
    return Float64Array.from(this.recorded.subarray(step * this.actuators, (step + 1) * this.actuators));
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
