import type { Simulation } from "../simulation/simulation";
import { floats, type Tensors } from "../tensors";
import type { Piece } from "../types";
import type { Player } from "./player";
import { checkLength } from "./recorded";

/** Hands that follow a plan made in Python: its commands, corrected by where the hands are (Python's `Tracker`). */
export class Planned implements Player {
  private readonly commands: Float32Array;
  private readonly positions: Float32Array;
  /** (steps, hands, n, n) in units of `gainUnit`, (hands, n), one for each column. */
  private readonly gains: Int8Array;
  private readonly gainUnit: Float32Array;
  private readonly feedback: number;
  private readonly actuators: number;
  private readonly hands: number;

  constructor(
    file: Tensors,
    private readonly simulation: Simulation,
  ) {
    this.commands = floats(file, "commands");
    this.positions = floats(file, "positions");
    this.gainUnit = floats(file, "gain_unit");
    this.gains = file.tensors.get("gains")!.data as Int8Array;
    this.feedback = Number(file.metadata["feedback"]);
    this.actuators = simulation.facts.ctrlLow.length;
    this.hands = simulation.facts.hands.length;
  }

  /** @throws InputError If the plan is of another piece. */
  prepare(piece: Piece): void {
    checkLength(piece, this.commands.length / this.actuators, "plan");
  }

  controls(step: number): Float64Array {
    const { ctrlLow, ctrlHigh } = this.simulation.facts;
    const positions = this.simulation.actuatorPositions();
    const first = step * this.actuators;
    const perHand = this.actuators / this.hands;
    const ahead = positions.map((position, i) => position - this.positions[first + i]!);
    return positions.map((_, i) => {
      const row = (first + i) * perHand;
      const hand = i - (i % perHand);
      let change = 0;
      for (let j = 0; j < perHand; j++) {
        // Rounded as in Python.
        change += Math.fround(this.gains[row + j]! * this.gainUnit[hand + j]!) * ahead[hand + j]!;
      }
      const command = this.commands[first + i]! - this.feedback * change;
      return Math.min(Math.max(command, ctrlLow[i]!), ctrlHigh[i]!);
    });
  }
}
