/**
 * Standard MIDI files, byte by byte, as far as a score needs them.
 *
 * Libraries join tracks, pair notes by rules of their own or read damaged files without a word; which note
 * a release belongs to and which files are refused has to be the same here and in Python. One thing differs: mido
 * 1.3 loses the time before a meta message of unknown kind.
 */

import { InputError } from "../types";

/** A message of a track that says something about notes, programs, the pedal, names or tempo. */
export type MidiEvent = { readonly tick: number } & (
  | { readonly type: "name"; readonly name: string }
  | { readonly type: "tempo"; readonly microseconds: number }
  | { readonly type: "program"; readonly channel: number; readonly program: number }
  | { readonly type: "control"; readonly channel: number; readonly control: number; readonly value: number }
  | { readonly type: "strike"; readonly channel: number; readonly pitch: number; readonly velocity: number }
  | { readonly type: "release"; readonly channel: number; readonly pitch: number }
);

export interface MidiTrackData {
  readonly events: readonly MidiEvent[];
  /** When its last message stands, whatever that says. */
  readonly end: number;
}

export interface MidiData {
  readonly ticksPerBeat: number;
  readonly tracks: readonly MidiTrackData[];
}

const META = 0xff;
const SYSEX = [0xf0, 0xf7];
const TRACK_NAME = 0x03;
const SET_TEMPO = 0x51;
const MOST_BYTES = 1_000_000; // of a message; longer ones are damage
/** Data bytes of the messages of the system, by status byte. */
const SYSTEM_BYTES: Readonly<Record<number, number>> = {
  0xf1: 1, 0xf2: 2, 0xf3: 1, 0xf6: 0, 0xf8: 0, 0xfa: 0, 0xfb: 0, 0xfc: 0, 0xfe: 0,
};

/**
 * Return what a file says; `name` is for messages.
 *
 * @throws InputError if the bytes are no complete MIDI file.
 */
export function parseMidi(bytes: Uint8Array, name: string): MidiData {
  try {
    return readFile(new Bytes(bytes));
  } catch (error) {
    if (!(error instanceof Damage)) throw error;
    throw new InputError(
      `“${name}” cannot be read as a MIDI file (${error.message}): expected a complete standard one.`,
    );
  }
}

class Damage extends Error {}

/** Bytes that are read one after the other. */
class Bytes {
  at = 0;

  constructor(private readonly bytes: Uint8Array) {}

  byte(): number {
    const value = this.bytes[this.at];
    if (value === undefined) throw new Damage("it ends too early");
    this.at += 1;
    return value;
  }

  take(count: number): Uint8Array {
    if (count > MOST_BYTES) throw new Damage(`a message of ${count} bytes`);
    if (this.at + count > this.bytes.length) throw new Damage("it ends too early");
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  /** Data of a message: bytes below 128. */
  data(count: number): Uint8Array {
    const data = this.take(count);
    const wrong = data.find((byte) => byte > 127);
    if (wrong !== undefined) throw new Damage(`a data byte of ${wrong}, expected 0 to 127`);
    return data;
  }

  unsigned(count: number): number {
    let value = 0;
    for (let i = 0; i < count; i++) value = value * 256 + this.byte();
    return value;
  }

  /** A number of variable length: seven bits in each byte, the highest bit says whether one follows. */
  variable(): number {
    let value = 0;
    for (;;) {
      const byte = this.byte();
      value = value * 128 + (byte & 0x7f);
      if (byte < 0x80) return value;
    }
  }

  text(count: number): string {
    return latin1(this.take(count));
  }
}

function readFile(file: Bytes): MidiData {
  if (file.text(4) !== "MThd") throw new Damage("it does not begin with MThd");
  const end = file.unsigned(4) + file.at;
  file.unsigned(2); // the format: tracks are read alike in all of them
  const count = file.unsigned(2);
  const ticksPerBeat = file.unsigned(2);
  if (ticksPerBeat === 0 || ticksPerBeat > 0x7fff) {
    throw new Damage("its times are not in ticks per beat");
  }
  if (end > file.at) file.take(end - file.at);
  return { ticksPerBeat, tracks: Array.from({ length: count }, () => readTrack(file)) };
}

function readTrack(file: Bytes): MidiTrackData {
  if (file.text(4) !== "MTrk") throw new Damage("a track does not begin with MTrk");
  const size = file.unsigned(4);
  const end = file.at + size;
  const events: MidiEvent[] = [];
  let tick = 0;
  let running = -1;
  while (file.at !== end) {
    tick += file.variable();
    let status = file.byte();
    if (status < 0x80) {
      if (running < 0) throw new Damage("a message without a status byte");
      status = running;
      file.at -= 1;
    } else if (status !== META) {
      running = status;
    }
    const event = readMessage(file, tick, status);
    if (event) events.push(event);
  }
  return { events, end: tick };
}

function readMessage(file: Bytes, tick: number, status: number): MidiEvent | null {
  if (status === META) {
    const kind = file.byte();
    return metaEvent(tick, kind, file.take(file.variable()));
  }
  if (SYSEX.includes(status)) {
    file.take(file.variable());
    return null;
  }
  if (status >= 0xf0) {
    const count = SYSTEM_BYTES[status];
    if (count === undefined) throw new Damage(`an undefined message ${status}`);
    file.data(count);
    return null;
  }
  return channelEvent(file, tick, status >> 4, status & 0x0f);
}

function metaEvent(tick: number, kind: number, data: Uint8Array): MidiEvent | null {
  if (kind === TRACK_NAME) return { type: "name", tick, name: latin1(data) };
  if (kind !== SET_TEMPO) return null;
  if (data.length < 3) throw new Damage("a tempo of fewer than three bytes");
  const microseconds = (data[0]! << 16) | (data[1]! << 8) | data[2]!;
  if (microseconds === 0) throw new Damage("a tempo of 0");
  return { type: "tempo", tick, microseconds };
}

function channelEvent(file: Bytes, tick: number, kind: number, channel: number): MidiEvent | null {
  const [first, second] = file.data(kind === 0xc || kind === 0xd ? 1 : 2) as unknown as [number, number];
  switch (kind) {
    case 0x8:
      return { type: "release", tick, channel, pitch: first };
    case 0x9:
      if (second === 0) return { type: "release", tick, channel, pitch: first };
      return { type: "strike", tick, channel, pitch: first, velocity: second };
    case 0xb:
      return { type: "control", tick, channel, control: first, value: second };
    case 0xc:
      return { type: "program", tick, channel, program: first };
    default:
      return null;
  }
}

function latin1(bytes: Uint8Array): string {
  return Array.from(bytes, (byte) => String.fromCharCode(byte)).join("");
}
