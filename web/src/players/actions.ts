import type { SceneFacts } from "../simulation/facts";

/** Map from actions in [-1, 1] onto the actuators' control ranges, and back (Python's `ActionMap`). */
export class ActionMap {
  private readonly middle: Float64Array;
  private readonly halfRange: Float64Array;

  constructor(facts: SceneFacts) {
    const { ctrlLow, ctrlHigh } = facts;
    this.middle = Float64Array.from(ctrlLow, (low, i) => (ctrlHigh[i]! + low) / 2);
    this.halfRange = Float64Array.from(ctrlLow, (low, i) => (ctrlHigh[i]! - low) / 2);
  }

  /** Targets of the actuators, (nu) rad or m, for an action; what is outside of [-1, 1] is clipped. */
  controls(action: ArrayLike<number>): Float64Array {
    return this.middle.map((middle, i) => middle + this.halfRange[i]! * Math.min(Math.max(action[i]!, -1), 1));
  }

  /** The action for targets of the actuators, (nu), in the 32 bits that environments take. */
  action(controls: ArrayLike<number>): Float32Array {
    return Float32Array.from(this.middle, (middle, i) => (controls[i]! - middle) / this.halfRange[i]!);
  }
}
