import { Quaternion, Vector3, type Object3D } from "three";

import type { SceneState } from "../types";

/** Where all bodies are at one time: a copy of what a scene's state shows. */
export class Pose {
  readonly positions: Float64Array;
  readonly quaternions: Float64Array;

  constructor(state: SceneState) {
    this.positions = Float64Array.from(state.bodyPositions);
    this.quaternions = Float64Array.from(state.bodyQuaternions);
  }

  /** Take over another pose of the same scene. */
  copy(state: { readonly positions: Float64Array; readonly quaternions: Float64Array }): void {
    this.positions.set(state.positions);
    this.quaternions.set(state.quaternions);
  }

  /** Take over what a state shows now. */
  read(state: SceneState): void {
    this.positions.set(state.bodyPositions);
    this.quaternions.set(state.bodyQuaternions);
  }
}

const _to = new Vector3();
const _turn = new Quaternion();

/** Put an object where a body is on the way from one pose to another, 0 to 1. */
export function placeBetween(object: Object3D, body: number, from: Pose, to: Pose, share: number): void {
  object.position.fromArray(from.positions, 3 * body).lerp(_to.fromArray(to.positions, 3 * body), share);
  read(object.quaternion, from, body).slerp(read(_turn, to, body), share);
}

function read(target: Quaternion, pose: Pose, body: number): Quaternion {
  const at = 4 * body;
  const [w, x, y, z] = [0, 1, 2, 3].map((i) => pose.quaternions[at + i]!) as [number, number, number, number];
  return target.set(x, y, z, w);
}
