import { speedOf } from "../music/dynamics";
import type { Simulation } from "../simulation/simulation";
import { NUM_KEYS, type KeyEvent, type Piece, type PianoRoll } from "../types";
import type { Placed, Player } from "./player";
import { restingControls } from "./visitor";

/** Loudness of a key that nothing strikes, or at a speed that is not known. */
export const VELOCITY = 80;

/** The piece itself: keys go down exactly as it is written, while the hands rest. */
export class ScorePlayer implements Player {
  private readonly resting: Float64Array;
  private roll: PianoRoll | null = null;
  private nextStrike = 0;

  constructor(private readonly simulation: Simulation) {
    this.resting = restingControls(simulation.facts);
  }

  prepare(piece: Piece): void {
    this.roll = piece.roll;
    this.nextStrike = 0;
  }

  controls(): Float64Array {
    return this.resting;
  }

  place(step: number): Placed {
    this.simulation.advance(this.resting);
    const { active, onset, strikes, controlTimestep } = this.roll!;
    const row = step * NUM_KEYS;
    const events: KeyEvent[] = [];
    for (let key = 0; key < NUM_KEYS; key++) {
      const was = step > 0 && active[row - NUM_KEYS + key] === 1;
      if (was && (active[row + key] === 0 || onset[row + key] === 1)) {
        events.push({ key, down: false, time: step * controlTimestep, speed: 0 });
      }
    }
    while (strikes[this.nextStrike]?.step === step) {
      const { key, time } = strikes[this.nextStrike++]!;
      events.push({ key, down: true, time, speed: speedOf(VELOCITY, key) });
    }
    this.simulation.placeKeys(active.subarray(row, row + NUM_KEYS));
    return { sounding: this.simulation.sounding, events };
  }
}
