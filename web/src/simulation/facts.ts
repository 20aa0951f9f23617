/** Addresses, indices and constants of the scene, as `sb3-piano export web` writes them to scene.json. */
export interface SceneFacts {
  /** Physics steps in a control step. */
  readonly substeps: number;
  /** Names of MuJoCo's bodies, the world first. */
  readonly bodyNames: readonly string[];
  /** (88) addresses of the keys' angles in qpos, one after the other, and of their speeds in qvel. */
  readonly keyQpos: readonly number[];
  readonly keyDof: readonly number[];
  /** (88) angles, rad: fully down, and from which on a key sounds. */
  readonly keyMaxAngle: readonly number[];
  readonly keySoundingAngle: readonly number[];
  /** (nu) control ranges of the actuators, the right hand's first; rad, or m for the sliders. */
  readonly ctrlLow: readonly number[];
  readonly ctrlHigh: readonly number[];
  /** (nu) what moves fingertips alike, rad or m; negative in the mirror (Python's `hand_action_unit`). */
  readonly handActionUnit: readonly number[];
  /** (m) addresses in qpos of both hands' joints, the right hand's first, the sliders last in each. */
  readonly handQpos: readonly number[];
  /** Those of them that hands of fewer joints have, too, in the same order. */
  readonly reducedHandQpos: readonly number[];
  /** (nu) for each actuator [index in `handQpos`, share]: where it is is the sum of share times joint. */
  readonly actuatorOfJoint: readonly (readonly [number, number][])[];
  /** The right hand, then the left one. */
  readonly hands: readonly HandFacts[];
  /** (10) geoms of the last links by finger. */
  readonly fingertipGeom: readonly number[];
  /** Sizes of MuJoCo's model, by their names there. */
  readonly counts: Readonly<Record<"nq" | "nv" | "nu" | "nbody" | "ngeom", number>>;
}

export interface HandFacts {
  /** (n) addresses in qpos and qvel of the joints, wrist to thumb, the sliders last. */
  readonly qpos: readonly number[];
  readonly dof: readonly number[];
}
