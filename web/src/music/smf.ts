/**
 * Standard MIDI files, as programs write them: chunks that are no track are skipped, no count or length is trusted that
 * the bytes contradict, and messages that no score needs are ignored. Python reads the same way (`midi_chunks.py`).
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
  /** Ticks of a quarter note, 0 if ticks are parts of a second. */
  readonly ticksPerBeat: number;
  /** Ticks of a second, 0 if they are parts of a beat. */
  readonly ticksPerSecond: number;
  readonly tracks: readonly MidiTrackData[];
  /** Number of messages whose data do not exist; see {@link MALFORMED}. */
  readonly malformed: number;
}

/** What becomes of malformed messages, for readers. */
export const MALFORMED =
  "a tempo or meter without value is ignored, data above 127 are read as 127, " +
  "what follows the end of a track is left out";

/**
 * Return what a file says; `name` is for messages.
 *
 * @throws InputError if it has no header or no track, or a track ends within a message.
 */
export function parseMidi(bytes: Uint8Array, name: string): MidiData {
  try {
    return parsed(bytes);
  } catch (error) {
    if (!(error instanceof Damage)) throw error;
    throw new InputError(
      `“${name}” cannot be read as a MIDI file (${error.message}): expected a complete standard one.`,
    );
  }
}

class Damage extends Error {}

const [HEADER, TRACK] = ["MThd", "MTrk"];
/** Bytes of a chunk before its contents: four letters and a length. */
const HEAD = 8;
/** Format of files whose tracks are pieces of their own. */
const SEQUENCES = 2;
/** Frames a second that stand for 30,000 in 1,001 s (MIDI 1.0). */
const NTSC = 29;
/** Types of meta messages. */
const [TRACK_NAME, END_OF_TRACK, TEMPO, METER] = [0x03, 0x2f, 0x51, 0x58];

function parsed(bytes: Uint8Array): MidiData {
  const start = find(bytes, HEADER, 0);
  if (start < 0) throw new Damage("it has no MThd, with which a MIDI file begins");
  if (start + HEAD + 6 > bytes.length) throw new Damage("it ends within its header");
  const kind = bytes[start + HEAD]! * 256 + bytes[start + HEAD + 1]!;
  const division = divisionOf(bytes[start + HEAD + 4]!, bytes[start + HEAD + 5]!);
  const tracks: MidiTrackData[] = [];
  let malformed = 0;
  let at = nextChunk(bytes, start + HEAD + 6, endOfChunk(bytes, start));
  while (at + HEAD <= bytes.length && lettersAt(bytes, at) !== HEADER) {
    const end = endOfChunk(bytes, at);
    let begin = at + HEAD;
    if (lettersAt(bytes, at) === TRACK) {
      const reader = new TrackReader(bytes, begin, end);
      tracks.push(reader.read());
      malformed += reader.malformed;
      begin = reader.at;
    }
    at = nextChunk(bytes, begin, end);
  }
  if (tracks.length === 0) throw new Damage("it has no track");
  if (kind === SEQUENCES && tracks.length > 1) throw new Damage(`it holds ${tracks.length} pieces, one a track`);
  return { ...division, tracks, malformed };
}

function divisionOf(high: number, low: number): Pick<MidiData, "ticksPerBeat" | "ticksPerSecond"> {
  if (high < 0x80 && (high > 0 || low > 0)) return { ticksPerBeat: high * 256 + low, ticksPerSecond: 0 };
  if (high < 0x80 || low === 0) throw new Damage("its ticks have no length");
  const frames = 256 - high;
  return { ticksPerBeat: 0, ticksPerSecond: (frames === NTSC ? 30_000 / 1_001 : frames) * low };
}

function lettersAt(bytes: Uint8Array, at: number): string {
  return String.fromCharCode(...bytes.subarray(at, at + 4));
}

function find(bytes: Uint8Array, letters: string, from: number): number {
  const first = letters.charCodeAt(0);
  let at = bytes.indexOf(first, from);
  while (at >= 0 && lettersAt(bytes, at) !== letters) at = bytes.indexOf(first, at + 1);
  return at;
}

function endOfChunk(bytes: Uint8Array, at: number): number {
  return at + HEAD + new DataView(bytes.buffer, bytes.byteOffset + at + 4, 4).getUint32(0);
}

/** Return whether a chunk may begin here, or the file ends, but for a few bytes of padding. */
function isBoundary(bytes: Uint8Array, at: number): boolean {
  const left = bytes.length - at;
  if (left < HEAD) return left >= 0;
  return bytes.subarray(at, at + 4).every((byte) => byte >= 32 && byte < 127);
}

/** Return where the next chunk begins; one ends at `end`, unless its length is wrong. */
function nextChunk(bytes: Uint8Array, begin: number, end: number): number {
  if (lettersAt(bytes, begin) === TRACK) return begin;
  if (end >= begin && isBoundary(bytes, end)) return end;
  const found = find(bytes, TRACK, begin);
  return found < 0 ? bytes.length : found;
}

/** Reads the messages of a track from `at`; `end` is its end by the length of the chunk. */
class TrackReader {
  malformed = 0;
  private readonly limit: number;
  private readonly events: MidiEvent[] = [];

  constructor(
    private readonly bytes: Uint8Array,
    public at: number,
    private readonly end: number,
  ) {
    // A length that leads to another track is right. Any other may be wrong.
    this.limit = lettersAt(bytes, end) === TRACK ? end : bytes.length;
  }

  /** Read up to the message at the end of the track, which some programs do not write. */
  read(): MidiTrackData {
    let [tick, running] = [0, 0];
    while (!this.isOver()) {
      tick += this.number();
      let status = this.at < this.limit ? this.bytes[this.at]! : 0;
      if (status >= 0x80) this.at++;
      else status = running;
      if (status === 0xff) {
        const kind = this.take(1)[0]!;
        const contents = this.take(this.number());
        if (kind === END_OF_TRACK) {
          if (this.at < this.end && isBoundary(this.bytes, this.end)) this.malformed++;
          break;
        }
        this.readMeta(tick, kind, contents);
      } else if (status === 0xf0 || status === 0xf7) {
        this.take(this.number());
      } else if (status > 0xf0) {
        this.take(status === 0xf2 ? 2 : status === 0xf1 || status === 0xf3 ? 1 : 0);
      } else if (status > 0) {
        running = status;
        this.readMessage(tick, status);
      } else {
        throw new Damage("a track has data before its first message");
      }
    }
    return { events: this.events, end: tick };
  }

  private isOver(): boolean {
    if (this.at === this.end) return isBoundary(this.bytes, this.at);
    return this.at === this.bytes.length && this.at > this.end;
  }

  private take(count: number): Uint8Array {
    const start = this.at;
    this.at += count;
    if (this.at > this.limit) throw new Damage("a track ends within a message");
    return this.bytes.subarray(start, this.at);
  }

  /** Read a number of one to four bytes, seven bits each. */
  private number(): number {
    let number = 0;
    for (let count = 0; count < 4; count++) {
      const byte = this.take(1)[0]!;
      number = number * 128 + (byte & 0x7f);
      if (byte < 0x80) return number;
    }
    throw new Damage("a time or a length has more than four bytes");
  }

  private readMeta(tick: number, kind: number, contents: Uint8Array): void {
    if (kind === TRACK_NAME) {
      this.events.push({ type: "name", tick, name: Array.from(contents, (byte) => String.fromCharCode(byte)).join("") });
    } else if (kind === TEMPO) {
      const [high, middle, low] = contents;
      const microseconds = low === undefined ? 0 : high! * 65536 + middle! * 256 + low;
      if (microseconds > 0) this.events.push({ type: "tempo", tick, microseconds });
      else this.malformed++;
    } else if (kind === METER && contents.length < 2) {
      this.malformed++;
    }
  }

  private readMessage(tick: number, status: number): void {
    const data = this.take(status >= 0xc0 && status < 0xe0 ? 1 : 2);
    if (data.some((byte) => byte > 127)) this.malformed++;
    const [first, second] = Array.from(data, (byte) => Math.min(byte, 127)) as [number, number];
    const channel = status & 0x0f;
    const kind = status & 0xf0;
    if (kind === 0xc0) {
      this.events.push({ type: "program", tick, channel, program: first });
    } else if (kind === 0xb0) {
      this.events.push({ type: "control", tick, channel, control: first, value: second });
    } else if (kind === 0x90 && second > 0) {
      this.events.push({ type: "strike", tick, channel, pitch: first, velocity: second });
    } else if (kind === 0x80 || kind === 0x90) {
      this.events.push({ type: "release", tick, channel, pitch: first });
    }
  }
}
