import type { Simulation } from "../simulation/simulation";
import type { Take } from "../take";
import { InputError, NUM_KEYS, type KeyEvent, type Piece } from "../types";
import { speedOf } from "../music/dynamics";
import { runsOf } from "../music/runs";
import { ActionMap } from "./actions";
import type { Placed, Player } from "./player";
import { VELOCITY } from "./score_player";

/**
 * A recorded performance: hands and keys are put where they were, control step by control step.
 *
 * When somebody interferes, its actions go on alone, in the simulation. A take of a scene with other actions stays as
 * it is.
 */
export class Recorded implements Player {
  private readonly map: ActionMap;
  /** Columns of the simulation's joint positions for those of the take; -1 for none. */
  private readonly columns: Int32Array;
  private readonly events: KeyEvent[][];
  private readonly canBeDisturbed: boolean;
  private disturbed = false;

  constructor(
    private readonly take: Take,
    private readonly simulation: Simulation,
  ) {
    this.map = new ActionMap(simulation.facts);
    this.columns = columnsOf(take, simulation);
    this.events = eventsOf(take);
    const { nu, nq } = simulation.facts.counts;
    this.canBeDisturbed = take.actions.shape[1] === nu + 1 && take.qpos.shape[1] === nq;
  }

  /** @throws InputError If the recording is of another piece. */
  prepare(piece: Piece): void {
    this.disturbed = false;
    checkLength(piece, this.take.steps, "recording");
    this.put(0);
  }

  disturb(): void {
    this.disturbed = this.canBeDisturbed;
  }

  place(step: number): Placed | null {
    if (this.disturbed) return null;
    this.put(step + 1);
    const sounding = this.take.sounding.subarray(step * NUM_KEYS, (step + 1) * NUM_KEYS);
    this.simulation.sounding.set(sounding);
    return { sounding, events: this.events[step] };
  }

  controls(step: number): Float64Array {
    const { shape, data } = this.take.actions;
    return this.map.controls(data.subarray(step * shape[1], (step + 1) * shape[1]));
  }

  /** Go to a state of the take; the velocities are those on the way to it. */
  private put(state: number): void {
    const { shape, data } = this.take.qpos;
    const { nq, nv } = this.simulation.facts.counts;
    const [qpos, qvel] = [new Float64Array(nq), new Float64Array(nv)];
    this.columns.forEach((column, i) => {
      const now = data[state * shape[1] + i];
      qpos[column] = now;
      // Every joint has one coordinate.
      if (state > 0) qvel[column] = (now - data[(state - 1) * shape[1] + i]) / this.take.roll.controlTimestep;
    });
    this.simulation.place(qpos, qvel);
  }
}

function columnsOf({ scene, qpos, handColumns }: Take, { facts }: Simulation): Int32Array {
  const joints = scene.reduced_action_space ? facts.reducedHandQpos : facts.handQpos;
  const half = joints.length / 2;
  const hands = scene.sides.flatMap((side) => (side === "right" ? joints.slice(0, half) : joints.slice(half)));
  const keys = facts.keyQpos.slice(scene.moving_keys[0], scene.moving_keys[1] + 1);
  const columns = new Int32Array(qpos.shape[1]).fill(-1);
  handColumns.forEach((column, i) => (columns[column] = hands[i] ?? -1));
  let next = 0;
  for (const [i, column] of columns.entries()) if (column < 0) columns[i] = keys[next++] ?? -1;
  if (hands.length !== handColumns.length || next !== keys.length || columns.includes(-1)) {
    throw new InputError(
      `The take has ${qpos.shape[1]} joints, ${handColumns.length} of them in hands: expected one of Shadow hands and ` +
        "a piano as on this page.",
    );
  }
  return columns;
}

/** The keys that moved in each control step. */
function eventsOf(take: Take): KeyEvent[][] {
  const events: KeyEvent[][] = Array.from({ length: take.steps }, () => []);
  runsOf(take.sounding, take.steps).forEach(({ key, first, end }, i) => {
    const speed = take.strikeSpeed[i];
    events[first].push({ key, down: true, time: take.strikeTime[i], speed: Number.isNaN(speed) ? speedOf(VELOCITY, key) : speed });
    if (end < take.steps) events[end].push({ key, down: false, time: take.releaseTime[i], speed: 0 });
  });
  return events;
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
