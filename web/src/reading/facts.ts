/**
 * Numbers of a scene from which pieces are read, and what each hand sees of itself: what `sb3-piano export web` writes
 * to reading.json. Lengths in m, angles in rad; positions are the world's: x points from the keys' hinges to the
 * player, y to the right, z up.
 */
export interface ReadingFacts {
  readonly keys: KeyPlaces;
  /** The right hand, then the left one. */
  readonly hands: readonly [HandShape, HandShape];
  /** Which of a hand's joints is the slider along the keyboard. */
  readonly slider: number;
  /** How the forearm's place across the keys changes with that slider. */
  readonly slope: number;
}

/** Geometry of the keys at rest: (88) each. */
export interface KeyPlaces {
  /** Centres across the keyboard. */
  readonly y: readonly number[];
  /** Height of the tops. */
  readonly top: readonly number[];
  /** Where along x the hinges are. */
  readonly hinge: readonly number[];
  /** Angle when fully down. */
  readonly maxAngle: readonly number[];
}

/** What a hand is like. */
export interface HandShape {
  /** 1 for the right hand, whose little finger is farthest along y; -1 for the left one. */
  readonly sign: 1 | -1;
  /** Place of the forearm, and of the middle finger, where all joints are at 0. */
  readonly middle: number;
  /** (5) radius of each fingertip, from thumb to little finger. */
  readonly radius: readonly number[];
  /** (5) how far along the axis of its capsule each fingertip is from the middle. */
  readonly tipAlong: readonly number[];
}
