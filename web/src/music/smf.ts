/**
 * Standard MIDI files, as far as a score needs them: what the library `midi-file` reads, checked.
 *
 * It reads damaged files without a word, with numbers that are not there; here they are refused, or read as Python reads
 * them.
 */

import { parseMidi as parseFile, type MidiData as ParsedFile, type MidiEvent as ParsedEvent } from "midi-file";

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

/**
 * Return what a file says; `name` is for messages.
 *
 * @throws InputError if the bytes are no complete MIDI file.
 */
export function parseMidi(bytes: Uint8Array, name: string): MidiData {
  try {
    const { header, tracks } = parsed(bytes);
    const { ticksPerBeat, format } = header;
    if (!ticksPerBeat) throw new Damage("its times are not in ticks per beat");
    if (format === SEQUENCES && tracks.length > 1) throw new Damage(`it holds ${tracks.length} pieces, one a track`);
    checkComplete(bytes, header.numTracks);
    return { ticksPerBeat, tracks: tracks.map(trackOf) };
  } catch (error) {
    if (!(error instanceof Damage)) throw error;
    throw new InputError(
      `“${name}” cannot be read as a MIDI file (${error.message}): expected a complete standard one.`,
    );
  }
}

/** Format of files whose tracks are pieces of their own. */
const SEQUENCES = 2;

/** Messages that may be the last ones of a track. */
const LAST: ReadonlySet<string> = new Set([
  "endOfTrack",
  "setTempo",
  "noteOn",
  "noteOff",
  "controller",
  "programChange",
  "noteAftertouch",
  "channelAftertouch",
]);

class Damage extends Error {}

function parsed(bytes: Uint8Array): ParsedFile {
  if (String.fromCharCode(...bytes.subarray(0, 4)) !== "MThd") throw new Damage("it does not begin with MThd");
  try {
    return parseFile(bytes);
  } catch (error) {
    // The library throws texts; what else it stumbles over is damage, too.
    throw new Damage(typeof error === "string" ? error : "its messages cannot be told apart");
  }
}

/** Make sure that header and tracks are as long as they say: of a file that is cut off the library reads what is there. */
function checkComplete(bytes: Uint8Array, tracks: number): void {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let at = 0;
  for (let chunk = 0; chunk <= tracks; chunk++) {
    if (at + 8 > bytes.length) throw new Damage("it ends too early");
    at += 8 + view.getUint32(at + 4);
  }
  if (at > bytes.length) throw new Damage("it ends too early");
}

function trackOf(messages: readonly ParsedEvent[]): MidiTrackData {
  // A wrong length within it makes the library read on beyond the track, up to nothing. Some files lack the message
  // at the end of a track; then it has to be one whose last byte is looked at.
  const last = messages.at(-1)?.type;
  if (last !== undefined && !LAST.has(last)) throw new Damage("a track does not end where it should");
  const events: MidiEvent[] = [];
  let tick = 0;
  for (const message of messages) {
    tick += message.deltaTime;
    const event = eventOf(message, tick);
    if (event !== null) events.push(event);
  }
  return { events, end: tick };
}

function eventOf(message: ParsedEvent, tick: number): MidiEvent | null {
  switch (message.type) {
    case "trackName":
      return { type: "name", tick, name: message.text };
    case "setTempo": {
      const microseconds = message.microsecondsPerBeat;
      if (!(microseconds > 0)) throw new Damage("a tempo of 0");
      return { type: "tempo", tick, microseconds };
    }
    case "noteOn":
      checkData(message.noteNumber, message.velocity);
      return { type: "strike", tick, channel: message.channel, pitch: message.noteNumber, velocity: message.velocity };
    case "noteOff":
      checkData(message.noteNumber, message.velocity);
      return { type: "release", tick, channel: message.channel, pitch: message.noteNumber };
    case "controller":
      checkData(message.controllerType, message.value);
      return { type: "control", tick, channel: message.channel, control: message.controllerType, value: message.value };
    case "programChange":
      checkData(message.programNumber);
      return { type: "program", tick, channel: message.channel, program: message.programNumber };
    case "noteAftertouch":
      checkData(message.noteNumber, message.amount);
      return null;
    case "channelAftertouch":
      checkData(message.amount);
      return null;
    default:
      return null;
  }
}

/** Refuse data bytes that are none; `undefined` is what the library reads beyond the end. */
function checkData(...bytes: readonly (number | undefined)[]): void {
  for (const byte of bytes) {
    if (byte === undefined) throw new Damage("a track ends too early");
    if (byte > 127) throw new Damage(`a data byte of ${byte}, expected 0 to 127`);
  }
}
