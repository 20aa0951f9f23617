import { Color, SRGBColorSpace } from "three";

import { UNKNOWN_FINGER } from "../types";

/** A colour, red, green and blue, each 0 to 1 in sRGB. */
export type Rgb = readonly [number, number, number];

/** Thumb to little finger, of both hands, as in Python's `sb3_piano.viewing.moment`: Okabe and Ito's without greens. */
export const FINGER_COLORS: readonly Rgb[] = [
  [0.84, 0.37, 0.0],
  [0.0, 0.45, 0.7],
  [0.94, 0.89, 0.26],
  [0.8, 0.47, 0.65],
  [0.34, 0.71, 0.91],
];

/** A note whose finger is not known. */
export const UNLABELLED_COLOR: Rgb = [0.55, 0.55, 0.62];
/** A key that sounds and should, and its note. */
export const PRESSED_COLOR: Rgb = [0.13, 0.72, 0.25];
/** A key that sounds and should not. */
export const WRONG_COLOR: Rgb = [0.8, 0.03, 0.1];
/** A note that is due while its key is silent. */
export const MISSED_COLOR: Rgb = [0.3, 0.3, 0.33];
/** A note whose key was struck, but too early or too late to hit it. */
export const MISTIMED_COLOR: Rgb = [0.72, 0.7, 0.3];

/** Colour of a finger 0-9, or of -1, unknown. */
export function fingerColor(finger: number): Rgb {
  return finger === UNKNOWN_FINGER ? UNLABELLED_COLOR : FINGER_COLORS[finger % FINGER_COLORS.length]!;
}

/** The same colour in the linear space that three.js computes in. */
export function linear(rgb: Rgb, target = new Color()): Color {
  return target.setRGB(...rgb, SRGBColorSpace);
}

/** The same colour for a style sheet or a canvas. */
export function css(rgb: Rgb, opacity = 1): string {
  const [red, green, blue] = rgb.map((part) => Math.round(part * 255));
  return `rgb(${red} ${green} ${blue} / ${opacity})`;
}
