import type { ReadingFacts } from "../reading/facts";
import type { Simulation } from "../simulation/simulation";
import { readTensors } from "../tensors";
import { type Assets, CONTROL_TIMESTEP, type Piece } from "../types";
import { HANDS_VERSION, HandEncoding } from "./hand_encoding";
import { HandNetwork } from "./hand_network";
import type { Player } from "./player";

/** The sight-reader: one learned network of a hand plays any piece at once, with both hands, without a plan. */
export class SightReader implements Player {
  private readonly encoding: HandEncoding;
  /** (nu) what an action of 1 adds to where the actuators are, rad, or m; negative in the mirror. */
  private readonly reach: Float64Array;

  /** @throws Error If the network was trained for another scene. */
  constructor(
    private readonly simulation: Simulation,
    facts: ReadingFacts,
    private readonly network: HandNetwork,
  ) {
    const scene = simulation.facts;
    this.encoding = new HandEncoding(facts, scene);
    this.reach = Float64Array.from(scene.handActionUnit, (unit) => network.reach * unit);
    const { observationVersion, controlTimestep, inputs, outputs } = network;
    const trained = [observationVersion, controlTimestep, 2 * inputs, 2 * outputs];
    const here = [HANDS_VERSION, CONTROL_TIMESTEP, this.encoding.size, scene.ctrlLow.length];
    if (trained.some((number, i) => number !== here[i])) {
      throw new Error(
        "The network was trained for an observation of version, control step, length and action of " +
          `${trained.join(", ")}, and here they are ${here.join(", ")}: expected files of one 'sb3-piano export web'.`,
      );
    }
  }

  /** Load it from the assets reading.json and sight_reader.safetensors. */
  static async load(assets: Assets, simulation: Simulation): Promise<SightReader> {
    const [facts, network] = await Promise.all([
      assets.json<ReadingFacts>("reading.json"),
      assets.bytes("sight_reader.safetensors"),
    ]);
    return new SightReader(simulation, facts, new HandNetwork(readTensors(network)));
  }

  prepare(piece: Piece): void {
    this.encoding.read(piece.roll);
  }

  controls(step: number): Float64Array {
    const action = this.network.act(this.encoding.write(step, this.simulation));
    const { ctrlLow, ctrlHigh } = this.simulation.facts;
    return this.simulation.actuatorPositions().map((position, i) => {
      const target = position + this.reach[i] * action[i];
      return Math.min(Math.max(target, ctrlLow[i]), ctrlHigh[i]);
    });
  }
}
