/** Reading MIDI files: notes, pedal, and hands or fingers from the names of the tracks. */

import { InputError, UNKNOWN_FINGER, type Note, type Pedal, type Score } from "../types";
import { FINGERS_PER_HAND } from "./constants";
import { LeftOut } from "./left_out";
import { handsOfTracks, type MidiNote, type MidiTrack } from "./midi_hands";
import { makeScore } from "./score";
import { parseMidi, type MidiData, type MidiEvent, type MidiTrackData } from "./smf";

const SUSTAIN_CONTROLLER = 64;
/** Value (0-127) from which a pedal counts as down (MIDI 1.0; the equal number is chance). */
const PEDAL_DOWN_FROM = 64;
const DRUM_CHANNEL = 9;

type Label = Pick<Note, "finger" | "hand">;

/** Labels by the names of tracks that Python writes. */
const LABELS: ReadonlyMap<string, Label> = new Map<string, Label>([
  ...[1, 2, 3, 4, 5].flatMap((number): [string, Label][] => [
    [`R${number}`, { finger: number - 1, hand: 0 }],
    [`L${number}`, { finger: FINGERS_PER_HAND + number - 1, hand: 1 }],
  ]),
  ["right", { finger: UNKNOWN_FINGER, hand: 0 }],
  ["left", { finger: UNKNOWN_FINGER, hand: 1 }],
  ["unlabelled", { finger: UNKNOWN_FINGER, hand: null }],
]);

/** A score from a file, with what could not be read of it. */
export interface ReadScore extends Score {
  /** Notes that were left out, in words. */
  readonly warnings: readonly string[];
}

/**
 * Read a MIDI file; its name without the suffix becomes the title.
 *
 * All tracks but drums are read as piano. The sustain pedal (controller 64, down from 64 on) is down while
 * any track holds it down. A pedal never released lasts until the end of the last note, a note never
 * released until the end of its track. Notes off the keyboard and notes without length are left out.
 *
 * @throws InputError if it is no complete MIDI file, or no note remains.
 */
export function readMidi(bytes: Uint8Array, name: string): ReadScore {
  const data = parseMidi(bytes, name);
  const seconds = secondsOf(data);
  const reader = new Reader();
  data.tracks.forEach((track, index) => reader.read(index, track));
  const leftOut = new LeftOut();
  for (const [tick, pitch] of reader.empty) leftOut.addEmpty(seconds(tick), pitch);
  const notes: Note[] = [];
  for (const [{ start, end, pitch, velocity }, label] of labelledNotes([...reader.tracks.values()])) {
    const [onset, offset] = [seconds(start), seconds(end)];
    if (leftOut.isPlayable(onset, offset, pitch)) {
      notes.push({ pitch, onset, offset, velocity, ...label });
    }
  }
  const missing = leftOut.toString();
  if (notes.length === 0) {
    const only = missing && `, only ${missing}`;
    throw new InputError(`“${name}” has no notes (drums do not count)${only}.`);
  }
  const end = notes.reduce((last, note) => Math.max(last, note.offset), 0);
  const pedals = reader.pedals
    .map(([down, up]): Pedal => ({ onset: seconds(down), offset: up === null ? end : seconds(up) }))
    .filter(({ onset, offset }) => offset > onset);
  const score = makeScore(notes, pedals, stemOf(name));
  return { ...score, warnings: missing ? [`The file also has ${missing}: left out.`] : [] };
}

/** Return the function from ticks to seconds, by the tempo changes of all tracks. */
function secondsOf({ ticksPerBeat, tracks }: MidiData): (tick: number) => number {
  const starts = [0];
  const times = [0];
  let lengths = [60 / (120 * ticksPerBeat)];
  const tempos = tracks
    .flatMap((track) => track.events)
    .filter((event) => event.type === "tempo")
    .sort((a, b) => a.tick - b.tick);
  for (const { tick, microseconds } of tempos) {
    const length = 60 / ((6e7 / microseconds) * ticksPerBeat);
    if (tick === 0) {
      lengths = [length];
    } else if (length !== lengths.at(-1)!) {
      times.push(times.at(-1)! + lengths.at(-1)! * (tick - starts.at(-1)!));
      starts.push(tick);
      lengths.push(length);
    }
  }
  return (tick) => {
    const after = starts.findIndex((start) => start > tick);
    const piece = (after < 0 ? starts.length : after) - 1;
    return times[piece]! + lengths[piece]! * (tick - starts[piece]!);
  };
}

/** A strike that still sounds: tick and velocity. */
type Strike = readonly [tick: number, velocity: number];

/** Goes through the tracks of a file. */
class Reader {
  /** Tracks that have notes, one for each program on a channel; without drums. */
  readonly tracks = new Map<string, MidiTrack>();
  /** Notes that are struck and released at one moment. */
  readonly empty: [tick: number, pitch: number][] = [];
  /** Presses of the sustain pedal; `up` is null if it is never released. */
  readonly pedals: [down: number, up: number | null][] = [];

  private index = 0;
  private name = "";
  private programs: number[] = [];
  private sounding = new Map<number, readonly Strike[]>();
  private down = new Map<number, number>();

  /** Note what the messages say, and release at the end what is left sounding. */
  read(index: number, track: MidiTrackData): void {
    this.index = index;
    this.name = "";
    this.programs = new Array<number>(16).fill(0);
    this.sounding = new Map();
    this.down = new Map();
    for (const event of track.events) this.readEvent(event);
    for (const at of [...this.sounding.keys()]) {
      const pitch = at % 128;
      this.release(track.end, Math.floor(at / 128), pitch);
      for (let left = this.sounding.get(at)?.length ?? 0; left > 0; left--) {
        this.empty.push([track.end, pitch]);
      }
    }
    for (const start of this.down.values()) this.pedals.push([start, null]);
  }

  private readEvent(event: MidiEvent): void {
    if (event.type === "name") this.name = event.name;
    if (!("channel" in event) || event.channel === DRUM_CHANNEL) return;
    if (event.type === "program") {
      this.programs[event.channel] = event.program;
    } else if (event.type === "strike") {
      const at = event.channel * 128 + event.pitch;
      this.sounding.set(at, [...(this.sounding.get(at) ?? []), [event.tick, event.velocity]]);
    } else if (event.type === "release") {
      this.release(event.tick, event.channel, event.pitch);
    } else if (event.control === SUSTAIN_CONTROLLER) {
      this.movePedal(event.tick, event.channel, event.value);
    }
  }

  private movePedal(tick: number, channel: number, value: number): void {
    const start = this.down.get(channel);
    if (value >= PEDAL_DOWN_FROM) {
      if (start === undefined) this.down.set(channel, tick);
    } else if (start !== undefined) {
      this.pedals.push([start, tick]);
      this.down.delete(channel);
    }
  }

  private release(tick: number, channel: number, pitch: number): void {
    const at = channel * 128 + pitch;
    const struck = this.sounding.get(at) ?? [];
    this.sounding.delete(at);
    const now = struck.filter(([start]) => start === tick);
    const before = struck.filter(([start]) => start !== tick);
    for (const [start, velocity] of before) {
      this.notesOf(channel).push({ start, end: tick, pitch, velocity });
    }
    if (before.length > 0 && now.length > 0) {
      // The release belongs to the earlier strike, written after the new one.
      this.sounding.set(at, now);
    } else {
      for (const _ of now) this.empty.push([tick, pitch]);
    }
  }

  private notesOf(channel: number): MidiNote[] {
    const program = this.programs[channel]!;
    const at = `${program} ${channel} ${this.index}`;
    let track = this.tracks.get(at);
    if (!track) {
      track = { name: this.name, program, notes: [] };
      this.tracks.set(at, track);
    }
    return track.notes;
  }
}

function labelledNotes(tracks: readonly MidiTrack[]): [MidiNote, Label][] {
  const hands = handsOfTracks(tracks);
  return tracks.flatMap((track, index) => {
    const label = labelOf(track.name) ?? { finger: UNKNOWN_FINGER, hand: hands[index]! };
    return track.notes.map((note): [MidiNote, Label] => [note, label]);
  });
}

/** Return the label that a track of ours is named by, nothing for one from elsewhere. */
function labelOf(trackName: string): Label | undefined {
  const name = trackName.trim();
  return LABELS.get(/^(\S+) \d+$/.exec(name)?.[1] ?? name);
}

function stemOf(name: string): string {
  const file = name.slice(name.lastIndexOf("/") + 1);
  const dot = file.lastIndexOf(".");
  return dot > 0 ? file.slice(0, dot) : file;
}
