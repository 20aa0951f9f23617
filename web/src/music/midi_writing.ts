/** Writing MIDI files: what was played, as loud as it was struck. */

import { MIN_PITCH, type KeyEvent, type Pedal } from "../types";
import { velocityOf } from "./dynamics";

/** Ticks of a quarter note, 120 of which last a minute. */
const TICKS_PER_QUARTER = 480;
const TICKS_PER_S = 2 * TICKS_PER_QUARTER;
const SUSTAIN = 64;

/**
 * A MIDI file of keys that moved and of the pedal; keys that are still down are let go of at the end, s.
 */
export function writeMidi(events: readonly KeyEvent[], pedals: readonly Pedal[], end: number): Uint8Array {
  const messages = events.map(({ key, down, time, speed }): [number, number[]] => [
    time,
    down ? [0x90, key + MIN_PITCH, velocityOf(speed, key)] : [0x80, key + MIN_PITCH, 0],
  ]);
  const down = new Set<number>();
  for (const event of events) down[event.down ? "add" : "delete"](event.key);
  for (const key of down) messages.push([end, [0x80, key + MIN_PITCH, 0]]);
  for (const { onset, offset } of pedals) {
    messages.push([onset, [0xb0, SUSTAIN, 127]], [offset, [0xb0, SUSTAIN, 0]]);
  }
  const track: number[] = [];
  let last = 0;
  for (const [time, message] of messages.sort((a, b) => a[0] - b[0])) {
    const tick = Math.round(time * TICKS_PER_S);
    track.push(...variable(tick - last), ...message);
    last = tick;
  }
  track.push(0, 0xff, 0x2f, 0);
  return Uint8Array.from([
    ...chunk("MThd", [0, 0, 0, 1, TICKS_PER_QUARTER >> 8, TICKS_PER_QUARTER & 255]),
    ...chunk("MTrk", track),
  ]);
}

function chunk(name: string, content: readonly number[]): number[] {
  const { length } = content;
  const letters = [...name].map((letter) => letter.charCodeAt(0));
  return [...letters, ...[24, 16, 8, 0].map((shift) => (length >> shift) & 255), ...content];
}

/** A number in groups of seven bits, all but the last marked. */
function variable(number: number): number[] {
  const groups = [number & 127];
  for (let rest = number >> 7; rest > 0; rest >>= 7) groups.unshift((rest & 127) | 128);
  return groups;
}
