/** The keys, their names and the fingers by number. */

import { MIN_PITCH, NUM_KEYS } from "../types";

export const MAX_PITCH = MIN_PITCH + NUM_KEYS - 1;

export const FINGERS_PER_HAND = 5;
export const THUMB = 0;
export const MIDDLE = 2;
export const RING = 3;
export const LITTLE = 4;

/** Number of a hand and its sign across the keyboard: 0 and 1 for the right one, 1 and -1 for the left. */
export const HANDS = [
  [0, 1],
  [1, -1],
] as const;

const NAMES = ["C", "C#", "D", "Eb", "E", "F", "F#", "G", "Ab", "A", "Bb", "B"];

/** Return whether a MIDI pitch, or a pitch class from C, is a black key. */
export function isBlack(pitch: number): boolean {
  return [1, 3, 6, 8, 10].includes(pitch % 12);
}

/** (88) which keys are black. */
export const KEY_IS_BLACK: readonly boolean[] = Array.from({ length: NUM_KEYS }, (_, key) =>
  isBlack(MIN_PITCH + key),
);

/** Return the name of a MIDI pitch, spelled as is most usual: "Eb4" and "F#4". */
export function pitchName(pitch: number): string {
  return `${NAMES[((pitch % 12) + 12) % 12]}${Math.floor(pitch / 12) - 1}`;
}

const FINGERS = ["thumb", "index", "middle", "ring", "little"];

/** Return the name of a finger 0-9: "right thumb". */
export function fingerName(finger: number): string {
  return `${finger < FINGERS_PER_HAND ? "right" : "left"} ${FINGERS[finger % FINGERS_PER_HAND]}`;
}
