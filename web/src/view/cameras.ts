import { MathUtils, PerspectiveCamera, Vector3 } from "three";

/** Names of views, as of Python's videos. */
export const VIEWS = ["stage", "close", "top"] as const;
export type View = (typeof VIEWS)[number];

/** A part of the keyboard, m along it. */
export interface Stretch {
  readonly middle: number;
  readonly width: number;
}

/** Angle between the lower and the upper edge of the picture, degrees, as in Python's `stage.FIELD_OF_VIEW`. */
export const FIELD_OF_VIEW = 16;

/** A camera that has a part of the keyboard in sight; the numbers are those of `sb3_piano.viewing.views`. */
interface Shot {
  /** Direction in which it looks, degrees: 180 is from the player to the keys. */
  readonly azimuth: number;
  /** Degrees; below 0 it looks down. */
  readonly elevation: number;
  /** What it looks at, m: across the keys, and the height. */
  readonly x: number;
  readonly z: number;
  /** Width in sight beside the keys and least height in sight, m. */
  readonly margin: number;
  readonly height: number;
}

// Straight down (-90) the camera's upright direction would not be defined.
const SHOTS: Readonly<Record<View, Shot>> = {
  stage: { azimuth: 180, elevation: -36, x: 0, z: 0.165, margin: 0.3, height: 0.42 },
  close: { azimuth: 140, elevation: -30, x: 0.04, z: 0.05, margin: 0.14, height: 0.22 },
  top: { azimuth: 180, elevation: -89.9, x: 0.05, z: 0, margin: 0.25, height: 0.3 },
};

/** Where a camera is and what it looks at, m. */
export interface Place {
  readonly position: Vector3;
  readonly target: Vector3;
}

/** Place from which a view has a stretch of the keyboard in sight, for a picture of some width by its height. */
export function placeOf(view: View, stretch: Stretch, aspect: number): Place {
  const shot = SHOTS[view];
  const height = Math.max((stretch.width + shot.margin) / aspect, shot.height);
  const distance = height / (2 * Math.tan(MathUtils.degToRad(FIELD_OF_VIEW / 2)));
  const azimuth = MathUtils.degToRad(shot.azimuth);
  const elevation = MathUtils.degToRad(shot.elevation);
  const forward = new Vector3(
    Math.cos(elevation) * Math.cos(azimuth),
    Math.cos(elevation) * Math.sin(azimuth),
    Math.sin(elevation),
  );
  const target = new Vector3(shot.x, stretch.middle, shot.z);
  return { position: target.clone().addScaledVector(forward, -distance), target };
}

/** A camera of the scene; z is up. */
export function newCamera(): PerspectiveCamera {
  const camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.2, 20);
  camera.up.set(0, 0, 1);
  return camera;
}
