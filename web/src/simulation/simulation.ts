import loadMujoco, { type MainModule, type MjData, type MjModel } from "@mujoco/mujoco";

import { CONTROL_TIMESTEP, NUM_KEYS, type Assets } from "../types";
import type { SceneFacts } from "./facts";

/** Torque that pushes a key down from outside, N m: about twice what holds it down. */
const PUSH = 0.3;

/** What is told after each physics step: its number in the control step, and all keys' angles and speeds. */
export type OnSubstep = (substep: number, angles: Float64Array, speeds: Float64Array) => void;

type Vector = readonly [number, number, number];

/**
 * MuJoCo's model and data of the scene, and what every control step does with them.
 *
 * As Python's `Simulation`: the position and velocity stages of the present state are always done, so that
 * places are those of `qpos`. The arrays are views into WebAssembly's memory, which may move: ask for them anew
 * in each control step.
 */
export class Simulation {
  /** (88) key angle over its largest angle, 0 to 1. */
  readonly keyState = new Float64Array(NUM_KEYS);
  /** (88) 1 where a key sounds. */
  readonly sounding = new Uint8Array(NUM_KEYS);
  private readonly firstKey: number;
  private readonly firstKeyDof: number;

  constructor(
    readonly facts: SceneFacts,
    private readonly mujoco: MainModule,
    private readonly model: MjModel,
    private readonly data: MjData,
  ) {
    this.firstKey = facts.keyQpos[0]!;
    this.firstKeyDof = facts.keyDof[0]!;
    this.reset();
  }

  /** (nq) joint positions, rad or m. */
  get qpos(): Float64Array {
    return this.data.qpos as Float64Array;
  }

  /** (nv) joint velocities, rad/s or m/s. */
  get qvel(): Float64Array {
    return this.data.qvel as Float64Array;
  }

  /** (ngeom, 3) positions of all shapes in the world, m. */
  get geomXpos(): Float64Array {
    return this.data.geom_xpos as Float64Array;
  }

  /** (ngeom, 9) their rotations, row by row. */
  get geomXmat(): Float64Array {
    return this.data.geom_xmat as Float64Array;
  }

  /** (nbody, 3) positions of the bodies, m. */
  get bodyXpos(): Float64Array {
    return this.data.xpos as Float64Array;
  }

  /** (nbody, 4) their quaternions, w x y z. */
  get bodyXquat(): Float64Array {
    return this.data.xquat as Float64Array;
  }

  /** Go to the beginning: all joints at 0, and nothing pushes or pulls. */
  reset(): void {
    this.mujoco.mj_resetData(this.model, this.data);
    this.look();
  }

  /**
   * Simulate a control step.
   *
   * @param controls (nu) what the actuators are told; rad, or m for the sliders.
   * @throws Error If the physics became unstable, after which MuJoCo is at its beginning.
   */
  advance(controls: ArrayLike<number>, onSubstep?: OnSubstep): void {
    const { mujoco, model, data } = this;
    const end = data.time + CONTROL_TIMESTEP;
    (data.ctrl as Float64Array).set(controls);
    for (let substep = 0; substep < this.facts.substeps; substep++) {
      if (substep === 0) mujoco.mj_step2(model, data);
      else mujoco.mj_step(model, data);
      onSubstep?.(substep, this.keys(this.qpos, this.firstKey), this.keys(this.qvel, this.firstKeyDof));
    }
    this.look();
    // MuJoCo answers NaN and huge numbers by starting the simulation anew.
    if (data.time < end - CONTROL_TIMESTEP / 2) {
      throw new Error("The physics became unstable: begin again, with less noise or less of a pull.");
    }
  }

  /** Go to joint positions, (nq), and velocities, (nv). */
  place(qpos: ArrayLike<number>, qvel: ArrayLike<number>): void {
    this.qpos.set(qpos);
    this.qvel.set(qvel);
    this.look();
  }

  /** Put keys down or up, (88) 1 or 0, without any force. */
  placeKeys(down: ArrayLike<number>): void {
    const qpos = this.qpos;
    for (let key = 0; key < NUM_KEYS; key++) {
      qpos[this.firstKey + key] = down[key] ? this.facts.keyMaxAngle[key]! : 0;
    }
    this.qvel.fill(0, this.firstKeyDof, this.firstKeyDof + NUM_KEYS);
    this.look();
  }

  /** Where the actuators are, (nu) rad, or m for the sliders. */
  actuatorPositions(): Float64Array {
    const { actuatorOfJoint, handQpos } = this.facts;
    const qpos = this.qpos;
    return Float64Array.from(actuatorOfJoint, (shares) =>
      shares.reduce((sum, [joint, share]) => sum + share * qpos[handQpos[joint]!]!, 0),
    );
  }

  /** Which keys sound at angles of all keys, rad. */
  soundingAt(angles: ArrayLike<number>, into: Uint8Array): void {
    const { keySoundingAngle } = this.facts;
    for (let key = 0; key < NUM_KEYS; key++) into[key] = angles[key]! >= keySoundingAngle[key]! ? 1 : 0;
  }

  /** Pull a body by a force (N) at a point of it (m), both in the world, until told otherwise. */
  pull(body: number, force: Vector, at: Vector): void {
    const [x, y, z] = (this.data.xipos as Float64Array).subarray(3 * body, 3 * body + 3);
    const [dx, dy, dz] = [at[0] - x!, at[1] - y!, at[2] - z!];
    const [fx, fy, fz] = force;
    const torque = [dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx];
    (this.data.xfrc_applied as Float64Array).set([...force, ...torque], 6 * body);
  }

  /** Let go of all bodies. */
  letGo(): void {
    (this.data.xfrc_applied as Float64Array).fill(0);
  }

  /** Push a key down from outside, or let go of it. */
  pushKey(key: number, down: boolean): void {
    (this.data.qfrc_applied as Float64Array)[this.facts.keyDof[key]!] = down ? PUSH : 0;
  }

  /** Free the memory of MuJoCo's objects. */
  dispose(): void {
    this.data.delete();
    this.model.delete();
  }

  /** Do the first stages of the present state, and read the keys. */
  private look(): void {
    this.mujoco.mj_step1(this.model, this.data);
    const { keyMaxAngle } = this.facts;
    const angles = this.keys(this.qpos, this.firstKey);
    this.soundingAt(angles, this.sounding);
    for (let key = 0; key < NUM_KEYS; key++) {
      const highest = keyMaxAngle[key]!;
      // Joint limits are soft.
      this.keyState[key] = Math.min(Math.max(angles[key]!, 0), highest) / highest;
    }
  }

  private keys(values: Float64Array, first: number): Float64Array {
    return values.subarray(first, first + NUM_KEYS);
  }
}

/**
 * Load MuJoCo and the scene from the assets mujoco.wasm, scene.xml and scene.json.
 *
 * @throws Error If the scene is another one than scene.json tells of.
 */
export async function loadSimulation(assets: Assets): Promise<Simulation> {
  const [wasm, xml, facts] = await Promise.all([
    assets.bytes("mujoco.wasm"),
    assets.bytes("scene.xml"),
    assets.json<SceneFacts>("scene.json"),
  ]);
  const mujoco = await loadMujoco({ wasmBinary: wasm });
  const model = mujoco.MjModel.from_xml_string(new TextDecoder().decode(xml));
  for (const [name, count] of Object.entries(facts.counts)) {
    const found = model[name as keyof SceneFacts["counts"]];
    if (found !== count) {
      throw new Error(
        `scene.xml has ${name} = ${found} and scene.json ${count}: expected files of one ` +
          "'sb3-piano export web'. Export them again.",
      );
    }
  }
  return new Simulation(facts, mujoco, model, new mujoco.MjData(model));
}
