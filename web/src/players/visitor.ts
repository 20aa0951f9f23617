import type { SceneFacts } from "../simulation/facts";
import type { Player } from "./player";

/** Commands that hold all joints at 0, or as near to it as they can be: (nu) rad, or m for the sliders. */
export function restingControls(facts: SceneFacts): Float64Array {
  return Float64Array.from(facts.ctrlLow, (low, i) => Math.min(Math.max(0, low), facts.ctrlHigh[i]!));
}

/** A visitor: pushes keys through the session, while the hands rest. */
export class Visitor implements Player {
  private readonly resting: Float64Array;

  constructor(facts: SceneFacts) {
    this.resting = restingControls(facts);
  }

  prepare(): void {}

  controls(): Float64Array {
    return this.resting;
  }
}
