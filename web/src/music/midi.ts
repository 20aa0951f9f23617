/** Reading MIDI files: notes, pedal, and hands or fingers from the names of the tracks. */

import { InputError, UNKNOWN_FINGER, type Note, type Pedal, type Score } from "../types";
import { FINGERS_PER_HAND } from "./constants";
import { LeftOut } from "./left_out";
import { handsOfTracks, type MidiNote, type MidiTrack } from "./midi_hands";
import { makeScore } from "./score";
import { MALFORMED, parseMidi, type MidiData, type MidiEvent, type MidiTrackData } from "./smf";

const SUSTAIN_CONTROLLER = 64;
/** Value (0-127) from which a pedal counts as down (MIDI 1.0; the equal number is chance). */
const PEDAL_DOWN_FROM = 64;
const DRUM_CHANNEL = 9;
const RESET_CONTROLLERS = 121;
/** All sound off, all notes off, and the changes of mode, which imply it (MIDI 1.0). */
const ENDS_ALL_NOTES: ReadonlySet<number> = new Set([120, 123, 124, 125, 126, 127]);

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
 * All tracks but drums are read as piano. A release ends all notes of its pitch, channel and track that sound, and if
 * there is none, those of other tracks that are released nowhere else; the controllers that silence a channel end its
 * notes in all tracks. A note never released lasts until the end of its track. The sustain pedal (controller 64, down
 * from 64 on) is down while any track holds it down; a pedal never released lasts until the end of the last note. Notes
 * off the keyboard and notes without length are left out.
 *
 * @throws InputError if it is no complete MIDI file, or no note remains.
 */
export function readMidi(bytes: Uint8Array, name: string): ReadScore {
  const data = parseMidi(bytes, name);
  const seconds = secondsOf(data);
  const reader = new Reader();
  data.tracks.forEach((track, index) => reader.read(index, track));
  reader.finish();
  const leftOut = new LeftOut();
  for (const [tick, pitch] of reader.empty) leftOut.addEmpty(seconds(tick), pitch);
  const notes: Note[] = [];
  for (const [{ start, end, pitch, velocity }, label] of labelledNotes(reader.tracks)) {
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
  const warnings = missing ? [`The file also has ${missing}: left out.`] : [];
  if (data.malformed > 0) warnings.push(`The file has ${inMessages(data.malformed)}: ${MALFORMED}.`);
  return { ...score, warnings };
}

function inMessages(count: number): string {
  return count === 1 ? "1 malformed message" : `${count} malformed messages`;
}

/** Return the function from ticks to seconds, by the tempo changes of all tracks. */
function secondsOf({ ticksPerBeat, ticksPerSecond, tracks }: MidiData): (tick: number) => number {
  if (ticksPerSecond > 0) return (tick) => tick / ticksPerSecond;
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

/** The notes of a track on one channel. */
interface TrackPlace {
  readonly channel: number;
  readonly track: MidiTrack;
}

/** Goes through the tracks of a file. */
class Reader {
  /** Notes that are struck and released at one moment. */
  readonly empty: [tick: number, pitch: number][] = [];
  /** Presses of the sustain pedal; `up` is null if it is never released. */
  readonly pedals: [down: number, up: number | null][] = [];

  private readonly places = new Map<string, TrackPlace>();
  // What a track leaves open, and what may close it in another track of the channel.
  private readonly open: [place: TrackPlace, note: MidiNote][] = [];
  private readonly openPedals: [channel: number, down: number][] = [];
  private readonly releases = new Map<number, number[]>();
  private readonly silences = new Map<number, number[]>();
  private readonly lifts = new Map<number, number[]>();

  private index = 0;
  private name = "";
  private programs: number[] = [];
  private sounding = new Map<number, readonly Strike[]>();
  private down = new Map<number, number>();

  /** Tracks that have notes, one for each program on a channel; without drums. */
  get tracks(): MidiTrack[] {
    return [...this.places.values()].map((place) => place.track).filter((track) => track.notes.length > 0);
  }

  /** Read the messages of a track. */
  read(index: number, track: MidiTrackData): void {
    this.index = index;
    this.name = "";
    this.programs = new Array<number>(16).fill(0);
    this.sounding = new Map();
    this.down = new Map();
    for (const event of track.events) this.readEvent(event);
    for (const [at, struck] of this.sounding) {
      const [channel, pitch] = [Math.floor(at / 128), at % 128];
      const place = this.placeOf(channel);
      for (const [start, velocity] of struck) this.open.push([place, { start, end: track.end, pitch, velocity }]);
    }
    this.openPedals.push(...this.down);
  }

  /** End what is still open, once all tracks are read. */
  finish(): void {
    for (const lists of [this.releases, this.silences, this.lifts]) {
      for (const ticks of lists.values()) ticks.sort((a, b) => a - b);
    }
    for (const [place, note] of this.open) {
      const released = nextOf(this.releases.get(place.channel * 128 + note.pitch), note.start);
      this.add(place, released === null ? note : { ...note, end: released });
    }
    for (const { channel, track } of this.places.values()) {
      track.notes.forEach((note, place) => {
        const end = nextOf(this.silences.get(channel), note.start);
        if (end !== null && end < note.end) track.notes[place] = { ...note, end };
      });
    }
    for (const [channel, down] of this.openPedals) this.pedals.push([down, nextOf(this.lifts.get(channel), down)]);
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
    } else if (event.control === RESET_CONTROLLERS) {
      this.movePedal(event.tick, event.channel, 0);
    } else if (ENDS_ALL_NOTES.has(event.control)) {
      addTo(this.silences, event.channel, event.tick);
    }
  }

  private movePedal(tick: number, channel: number, value: number): void {
    const start = this.down.get(channel);
    if (value >= PEDAL_DOWN_FROM) {
      if (start === undefined) this.down.set(channel, tick);
    } else if (start !== undefined) {
      this.pedals.push([start, tick]);
      this.down.delete(channel);
    } else {
      addTo(this.lifts, channel, tick);
    }
  }

  private release(tick: number, channel: number, pitch: number): void {
    const at = channel * 128 + pitch;
    const struck = this.sounding.get(at);
    if (struck === undefined) {
      addTo(this.releases, at, tick);
      return;
    }
    this.sounding.delete(at);
    const now = struck.filter(([start]) => start === tick);
    const before = struck.filter(([start]) => start !== tick);
    for (const [start, velocity] of before) {
      this.add(this.placeOf(channel), { start, end: tick, pitch, velocity });
    }
    if (before.length > 0 && now.length > 0) {
      // The release belongs to the earlier strike, written after the new one.
      this.sounding.set(at, now);
    } else {
      for (const _ of now) this.empty.push([tick, pitch]);
    }
  }

  private placeOf(channel: number): TrackPlace {
    const program = this.programs[channel]!;
    const at = `${program} ${channel} ${this.index}`;
    const known = this.places.get(at);
    if (known) return known;
    const place = { channel, track: { name: this.name, program, notes: [] } };
    this.places.set(at, place);
    return place;
  }

  private add(place: TrackPlace, note: MidiNote): void {
    if (note.end > note.start) place.track.notes.push(note);
    else this.empty.push([note.start, note.pitch]);
  }
}

function addTo(lists: Map<number, number[]>, at: number, tick: number): void {
  const ticks = lists.get(at);
  if (ticks) ticks.push(tick);
  else lists.set(at, [tick]);
}

/** Return the first of the sorted ticks that is later than `start`. */
function nextOf(ticks: readonly number[] | undefined, start: number): number | null {
  return ticks?.find((tick) => tick > start) ?? null;
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
