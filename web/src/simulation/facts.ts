/** Addresses, indices and constants of the scene, as `sb3-piano export web` writes them to scene.json. */
export interface SceneFacts {
  /** Physics steps in a control step. */
  readonly substeps: number;
  /** Names of MuJoCo's bodies, the world first. */
  readonly bodyNames: readonly string[];
  /** (88) addresses of the keys' angles in qpos, one after the other, and in qvel; their geoms and bodies. */
  readonly keyQpos: readonly number[];
  readonly keyDof: readonly number[];
  readonly keyGeom: readonly number[];
  readonly keyBody: readonly number[];
  /** (88) angles, rad: fully down, and from which on a key sounds. */
  readonly keyMaxAngle: readonly number[];
  readonly keySoundingAngle: readonly number[];
  /** (88, 3) from a key geom's centre to the point where a finger should press it, m. */
  readonly keyPressOffset: readonly (readonly [number, number, number])[];
  /** Command of the pedal, in [0, 1], from which on it is down. */
  readonly pedalThreshold: number;
  /** (nu) names and control ranges of the actuators, the right hand's first; rad, or m for the sliders. */
  readonly actuatorNames: readonly string[];
  readonly ctrlLow: readonly number[];
  readonly ctrlHigh: readonly number[];
  /** (nu) what moves fingertips alike, rad or m; negative in the mirror (Python's `hand_action_unit`). */
  readonly handActionUnit: readonly number[];
  /** (m) addresses in qpos of both hands' joints, the right hand's first, the sliders last in each. */
  readonly handQpos: readonly number[];
  /** (nu) for each actuator [index in `handQpos`, share]: where it is is the sum of share times joint. */
  readonly actuatorOfJoint: readonly (readonly [number, number][])[];
  /** The right hand, then the left one. */
  readonly hands: readonly HandFacts[];
  /** (10) by finger: the sites at the fingertips, and the geoms of the last links. */
  readonly fingertipSite: readonly number[];
  readonly fingertipGeom: readonly number[];
  /** (2) addresses in qpos of the sliders along the keyboard. */
  readonly sliderQpos: readonly number[];
  /** Sizes of MuJoCo's model, by their names there. */
  readonly counts: Readonly<Record<"nq" | "nv" | "nu" | "nbody" | "ngeom" | "nsite", number>>;
  /** Version of MuJoCo with which Python measured. */
  readonly mujoco: string;
}

export interface HandFacts {
  readonly side: "right" | "left";
  /** (n) names of the joints, addresses in qpos and qvel, and limits (low, high) in rad or m. */
  readonly jointNames: readonly string[];
  readonly qpos: readonly number[];
  readonly dof: readonly number[];
  readonly jointRange: readonly (readonly [number, number])[];
}
