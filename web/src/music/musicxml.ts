/** Reading MusicXML: the notes, ties, tempo, pedal, hands and fingers of a piano's part. */

import { InputError, UNKNOWN_FINGER, type Note, type Pedal } from "../types";
import { FINGERS_PER_HAND } from "./constants";
import { LeftOut } from "./left_out";
import type { ReadScore } from "./midi";
import { handOfName } from "./midi_hands";
import { Measures } from "./musicxml_order";
import { makeScore } from "./score";
import { parseXml, type XmlElement } from "./xml";

/** Velocity of a note without one, and of 100 per cent. */
const DEFAULT_VELOCITY = 80;
const FORTE = 90;
/** Longest grace note, and how long the pedal is up at a change, s. */
const GRACE = 0.1;
const LIFT = 0.1;
/** Times nearer to each other than this are equal, quarter notes or s. */
const EQUAL = 1e-6;

const SEMITONES: Readonly<Record<string, number>> = { C: 0, D: 2, E: 4, F: 5, G: 7, A: 9, B: 11 };
const KINDS = ["breve", "whole", "half", "quarter", "eighth", "16th", "32nd", "64th", "128th", "256th"];
const KEYBOARDS = /piano|pno|\bpf(te?)?\b|klav|clavi|clave[cm]|cemb|harpsi|keyboard|\bkeys\b|organ|orgel|celesta|tasten/i;

const JUMPS = /\bd\. ?[cs]\b|\bda ?capo\b|\bdal segno\b/i;

/** A note of the file; times in quarter notes, then s. */
interface Written {
  start: number;
  end: number;
  readonly pitch: number;
  readonly voice: string;
  readonly staff: number;
  readonly finger: number;
  readonly velocity: number;
  readonly tiedBack: boolean;
  readonly tiedOn: boolean;
  readonly inChord: boolean;
  readonly isGrace: boolean;
  readonly isStaccato: boolean;
}

/**
 * Return the MusicXML document of a file, or null if it is none.
 *
 * @param files What an archive (.mxl) has, null for a plain file.
 * @throws InputError If an archive has no document.
 */
export function documentOf(
  bytes: Uint8Array,
  files: ReadonlyMap<string, Uint8Array> | null,
  name: string,
): string | null {
  if (files === null) {
    const text = decoded(bytes);
    return text.trimStart().startsWith("<") ? text : null;
  }
  const container = files.get("META-INF/container.xml");
  const paths = [...(container ? decoded(container) : "").matchAll(/full-path\s*=\s*["']([^"']+xml)["']/gi)];
  const named = paths.map(([, path]) => path).find((path) => files.has(path));
  const others = [...files.keys()].filter((file) => /^(?!META-INF|.*\/\.).*\.(xml|musicxml)$/i.test(file));
  const found = files.get(named ?? "") ?? files.get(others[0] ?? "");
  if (found === undefined) {
    throw new InputError(`“${name}” has neither MusicXML nor a take in it: expected a .mxl file or performance.npz.`);
  }
  return decoded(found);
}

function decoded(bytes: Uint8Array): string {
  const wide = bytes[0] === 0xff || (bytes[0] !== 0 && bytes[1] === 0) ? "utf-16le" : "utf-16be";
  const encoding = bytes[0] === 0xfe || bytes[0] === 0xff || bytes[0] === 0 || bytes[1] === 0 ? wide : "utf-8";
  return new TextDecoder(encoding).decode(bytes);
}

/**
 * Read MusicXML, as Python's `read_musicxml` does, but for jumps (D.C., D.S.), swing and repeats within repeats.
 *
 * @throws InputError If it is none, has no notes, or no part is a piano's.
 */
export function readMusicXml(text: string, name: string): ReadScore {
  try {
    return read(parseXml(text), name);
  } catch (error) {
    if (error instanceof InputError) throw error;
    throw new InputError(`“${name}” cannot be read as MusicXML: ${(error as Error).message}.`);
  }
}

function read(root: XmlElement, name: string): ReadScore {
  if (root.tag !== "score-partwise") throw new Error(`its root is <${root.tag}>, not <score-partwise>`);
  const names = new Map(root.all("part-list/score-part").map((part) => [part.attribute("id"), part.textAt("part-name")]));
  const measures = new Measures();
  const elements = root.all("part");
  const divisions = elements.map(divisionsOf).find((divisions) => divisions !== undefined) ?? 1;
  const parts = elements.map((part) => new Part(names.get(part.attribute("id")) ?? "", part, measures, divisions));
  for (let number = 0; parts.some((part) => number < part.measures.length); number++) {
    const start = measures.end;
    const end = Math.max(...parts.map((part) => part.read(number, start)));
    const [meter] = parts.map((part) => part.meter).sort((a, b) => b - a);
    measures.close(end > start + EQUAL ? end : start + meter);
  }
  const sounding = parts.filter((part) => part.notes.length > 0);
  const played = ofPiano(sounding, name);
  const line = measures.timeline();
  const hands = handsOf(played);
  const notes = played.flatMap((part, index) => timed(part.notes, line).map((note) => ({ note, hand: hands(index, note) })));
  const wait = Math.max(0, ...notes.map(({ note }) => -note.start));
  const leftOut = new LeftOut();
  const kept = notes
    .map(({ note, hand }): Note => {
      const finger = note.finger > 0 && hand !== null ? note.finger - 1 + FINGERS_PER_HAND * hand : UNKNOWN_FINGER;
      return { onset: exact(note.start + wait), offset: exact(note.end + wait), pitch: note.pitch, velocity: note.velocity, finger, hand };
    })
    .filter((note) => leftOut.isPlayable(note.onset, note.offset - EQUAL, note.pitch));
  if (kept.length === 0) throw new InputError(`“${name}” has no notes to play.`);
  const pedals = played.flatMap((part) => pressesOf(part, line, wait));
  const title = root.textAt("work/work-title") || root.textAt("movement-title") || name.replace(/\.\w+$/, "");
  const others = sounding.filter((part) => !played.includes(part)).map((part) => `“${part.name}”`);
  const warnings = [
    leftOut.toString() && `The file also has ${leftOut}: left out.`,
    others.length > 0 ? `Only the piano is read, not ${others.join(", ")}.` : "",
    measures.hasJumps ? "Jumps (D.C., D.S.) are not followed on this page." : "",
  ];
  return { ...makeScore(kept, pedals, title), warnings: warnings.filter(Boolean) };
}

/** The part of an instrument, read measure by measure. */
class Part {
  readonly measures: readonly XmlElement[];
  readonly notes: Written[] = [];
  readonly pedal: { readonly at: number; readonly kind: string }[] = [];
  staves = 1;
  clef = "";
  /** Length of a measure, quarter notes. */
  meter = 0;
  private divisions: number;
  private here = 0;
  private struck: [number, number] = [0, 0];
  private readonly transposed = new Map<string, number>();

  constructor(
    readonly name: string,
    element: XmlElement,
    private readonly marks: Measures,
    others: number,
  ) {
    this.measures = element.all("measure");
    this.divisions = divisionsOf(element) ?? others;
  }

  /** Read a measure; return the end of its longest voice. */
  read(index: number, start: number): number {
    this.here = start;
    let end = start;
    for (const child of this.measures[index]?.children ?? []) {
      if (child.tag === "note") this.readNote(child);
      else if (child.tag === "backup") this.here = Math.max(start, this.here - this.duration(child));
      else if (child.tag === "forward") this.here += this.duration(child);
      else if (child.tag === "attributes") this.readAttributes(child);
      else if (child.tag === "direction") this.readDirection(child);
      else if (child.tag === "sound") this.readSound(child, this.here);
      else if (child.tag === "barline") this.marks.addBarline(child);
      end = Math.max(end, this.here);
    }
    return end;
  }

  private duration(element: XmlElement): number {
    return number(element.textAt("duration")) / this.divisions;
  }

  private readNote(element: XmlElement): void {
    const isGrace = element.first("grace") !== undefined;
    const inChord = element.first("chord") !== undefined;
    let duration = this.duration(element);
    const written = valueOf(element.textAt("type"), element.all("dot").length);
    if (duration === 0 && !isGrace) {
      duration = element.first("rest")?.attribute("measure") === "yes" ? this.meter : written;
    }
    if (!inChord) {
      this.struck = [this.here, this.here + duration];
      this.here += duration;
    } else if (duration > 0 && [0, duration].includes(written)) {
      this.struck = [this.struck[0], this.struck[0] + duration];
    }
    const step = element.textAt("pitch/step");
    if (element.first("pitch") === undefined || element.first("cue") !== undefined) return;
    if (!(step in SEMITONES)) throw new Error(`a pitch has the step “${step}”`);
    const height = 12 * (number(element.textAt("pitch/octave")) + 1) + SEMITONES[step] + number(element.textAt("pitch/alter"));
    const ties = new Set([...element.all("tie"), ...element.all("notations/tied")].map((tie) => tie.attribute("type")));
    const staff = element.textAt("staff") || "1";
    const velocity = (number(element.attribute("dynamics")) * FORTE) / 100 || DEFAULT_VELOCITY;
    const dots = ["staccato", "staccatissimo", "spiccato"];
    this.notes.push({
      start: this.struck[0],
      end: this.struck[1],
      pitch: Math.round(height) + (this.transposed.get(staff) ?? this.transposed.get("") ?? 0),
      voice: element.textAt("voice") || "1",
      staff: Number(staff),
      finger: number(/^\s*([1-5])/.exec(element.textAt("notations/technical/fingering"))?.[1] ?? ""),
      velocity: Math.min(127, Math.max(1, Math.round(velocity))),
      tiedBack: ties.has("stop") || ties.has("continue"),
      tiedOn: ties.has("start") || ties.has("continue"),
      inChord,
      isGrace,
      isStaccato: dots.some((dot) => element.first(`notations/articulations/${dot}`) !== undefined),
    });
    this.staves = Math.max(this.staves, Number(staff));
  }

  private readAttributes(element: XmlElement): void {
    this.divisions = number(element.textAt("divisions")) || this.divisions;
    this.staves = Math.max(this.staves, number(element.textAt("staves")));
    const beats = element.textAt("time/beats").split("+").map(number);
    if (element.first("time/beats")) {
      this.meter = (4 * beats.reduce((a, b) => a + b)) / (number(element.textAt("time/beat-type")) || 4);
    }
    this.clef ||= element.all("clef").find((clef) => ["", "1"].includes(clef.attribute("number")))?.textAt("sign") ?? "";
    for (const transpose of element.all("transpose")) {
      const semitones = number(transpose.textAt("chromatic")) + 12 * number(transpose.textAt("octave-change"));
      const staff = transpose.attribute("number");
      if (staff === "") this.transposed.clear();
      this.transposed.set(staff, Math.round(semitones));
    }
  }

  private readDirection(element: XmlElement): void {
    const offset = element.first("offset");
    const moved = offset?.attribute("sound") === "yes" ? number(offset.text) / this.divisions : 0;
    const at = Math.max(0, this.here + moved);
    const words = element.all("direction-type/words").map((one) => one.text).join(" ");
    if (JUMPS.test(words)) this.marks.hasJumps = true;
    const sound = element.first("sound");
    if (sound) this.readSound(sound, at);
    for (const mark of element.all("direction-type/metronome")) {
      const beat = valueOf(mark.textAt("beat-unit"), mark.all("beat-unit-dot").length);
      const tempo = beat * number(/\d+([.,]\d+)?/.exec(mark.textAt("per-minute"))?.[0] ?? "");
      if (tempo > 0 && !sound?.attribute("tempo")) this.marks.addTempo(at, tempo, false);
    }
    if (sound?.attribute("damper-pedal")) return;
    for (const mark of element.all("direction-type/pedal")) {
      const kind = mark.attribute("type");
      if (["start", "change", "stop"].includes(kind)) this.pedal.push({ at, kind });
    }
  }

  private readSound(element: XmlElement, at: number): void {
    const tempo = number(element.attribute("tempo"));
    if (tempo > 0) this.marks.addTempo(at, tempo, true);
    const damper = element.attribute("damper-pedal");
    if (damper) this.pedal.push({ at, kind: damper === "yes" || number(damper) >= 50 ? "hold" : "stop" });
    if (["dacapo", "dalsegno"].some((jump) => element.attribute(jump))) this.marks.hasJumps = true;
  }
}

/** The first divisions of a quarter note in a part. */
function divisionsOf(part: XmlElement): number | undefined {
  return part.all("measure/attributes/divisions").map((one) => number(one.text)).find((divisions) => divisions > 0);
}

/** A number, with a comma or a point; 0 for no number. */
function number(text: string): number {
  return Number(text.trim().replace(",", ".")) || 0;
}

/** A time without what rounding adds, by which notes of a chord differ. */
function exact(time: number): number {
  return Number(time.toFixed(9));
}

/** Length of a kind of note, quarter notes. */
function valueOf(kind: string, dots: number): number {
  const index = KINDS.indexOf(kind);
  return index < 0 ? 0 : 8 / 2 ** index * (2 - 1 / 2 ** dots);
}

/** @throws InputError If it is not clear which parts a pianist plays. */
function ofPiano(parts: readonly Part[], name: string): readonly Part[] {
  if (parts.length === 0) throw new InputError(`“${name}” has no notes with a pitch.`);
  if (parts.length === 1) return parts;
  const named = parts.filter((part) => KEYBOARDS.test(part.name) || handOfName(part.name) !== null);
  const grand = parts.filter((part) => part.staves > 1);
  const isHand = named.length === 1 && named[0].staves === 1 && parts.length === 2;
  if (named.length > 0) return isHand ? parts : named;
  if (grand.length === 1) return grand;
  if (parts.length === 2 && grand.length === 0) return parts;
  const all = parts.map((part) => `“${part.name}”`).join(", ");
  throw new InputError(`“${name}” has ${parts.length} parts (${all}): expected one of a piano, with two staves or its name.`);
}

/** Return the function from a part's index and a note to its hand: 0 right, 1 left, null if it is unknown. */
function handsOf(parts: readonly Part[]): (part: number, note: Written) => 0 | 1 | null {
  const hands = parts.map((part) => handOfName(part.name));
  const [first, second] = [...parts.keys()].filter((index) => parts[index].staves === 1);
  if (parts.filter((part) => part.staves === 1).length === 2) {
    const higher = middleOf(parts[first]) >= middleOf(parts[second]);
    const known = hands[first] ?? (hands[second] === null ? null : ((1 - hands[second]) as 0 | 1));
    const right = known ?? (higher ? 0 : null);
    if (right !== null) [hands[first], hands[second]] = [right, (1 - right) as 0 | 1];
  } else if (parts.length === 1 && hands[0] === null && parts[0].notes.some((note) => note.finger > 0)) {
    hands[0] = parts[0].clef === "F" ? 1 : 0;
  }
  return (index, { staff }) => {
    if (parts[index].staves === 1) return hands[index];
    return parts[index].staves === 2 ? ((staff - 1) as 0 | 1) : null;
  };
}

function middleOf({ notes }: Part): number {
  const pitches = notes.map((note) => note.pitch).sort((a, b) => a - b);
  const half = pitches.length >> 1;
  return pitches.length % 2 ? pitches[half] : (pitches[half - 1] + pitches[half]) / 2;
}

type Line = ReturnType<Measures["timeline"]>;

/** Return the notes as they are played, in s: repeated, tied, grace notes before the beat. */
function timed(written: readonly Written[], line: Line): Written[] {
  const dotted = dottedChords(written);
  const played = written
    .flatMap((note) =>
      line(note.start, note.end).map(([start, end]) => {
        const isShort = dotted.has(note) && !note.tiedBack && !note.tiedOn;
        return { ...note, start, end: isShort ? (start + end) / 2 : end };
      }),
    )
    .sort((a, b) => a.start - b.start);
  const joined: Written[] = [];
  const open = new Map<number, Written[]>();
  for (const note of played) {
    const ties = open.get(note.pitch) ?? [];
    open.set(note.pitch, ties);
    const meeting = note.tiedBack ? ties.filter((tie) => Math.abs(tie.end - note.start) < EQUAL) : [];
    const whole = meeting.find((tie) => tie.voice === note.voice) ?? meeting[0];
    if (whole) {
      ties.splice(ties.indexOf(whole), 1);
      whole.end = Math.max(whole.end, note.end);
    } else {
      joined.push(note);
    }
    if (note.tiedOn) ties.push(whole ?? note);
  }
  return withGraceTimes(joined);
}

/** Return the notes of chords one of whose notes has a dot. */
function dottedChords(notes: readonly Written[]): Set<Written> {
  const found = new Set<Written>();
  let chord: Written[] = [];
  for (const note of notes) {
    chord = note.inChord ? [...chord, note] : [note];
    if (chord.some((one) => one.isStaccato)) chord.forEach((one) => found.add(one));
  }
  return found;
}

function withGraceTimes(notes: Written[]): Written[] {
  const onsets = notes.filter((note) => !note.isGrace).map((note) => note.start);
  for (const note of notes.filter((one) => one.isGrace)) {
    const at = note.start;
    const run = notes.filter((one) => one.isGrace && one.voice === note.voice && one.start === at);
    const strikes = run.filter((one) => !one.inChord);
    const before = onsets.filter((onset) => onset < at - EQUAL).at(-1);
    const length = Math.min(GRACE, before === undefined ? GRACE : (at - before) / 2 / strikes.length);
    let left = strikes.length;
    run.forEach((one, index) => {
      if (index > 0 && !one.inChord) left--;
      const isTied = one.end > at + EQUAL;
      one.start = at - left * length;
      if (!isTied) one.end = one.start + length;
    });
  }
  return notes;
}

function pressesOf({ pedal }: Part, line: Line, wait: number): Pedal[] {
  const spans: [number, number][] = [];
  let down: number | null = null;
  const signs = [...pedal].sort((a, b) => a.at - b.at || Number(a.kind !== "stop") - Number(b.kind !== "stop"));
  for (const { at, kind } of signs) {
    if (down !== null && kind !== "hold") {
      spans.push([down, at]);
      down = null;
    }
    if (down === null && kind !== "stop") down = at;
  }
  if (down !== null) spans.push([down, line.end]);
  const played = spans.flatMap(([start, end]) => line(start, end)).sort((a, b) => a[0] - b[0]);
  const presses: Pedal[] = [];
  let lastUp = -Infinity;
  played.forEach(([start, end], i) => {
    const up = Math.min(end, played[i + 1]?.[0] ?? Infinity);
    const onset = start > lastUp + EQUAL ? start : lastUp + LIFT;
    if (up <= onset) return;
    lastUp = up;
    presses.push({ onset: onset + wait, offset: up + wait });
  });
  return presses;
}
