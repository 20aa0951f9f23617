/** Takes: performances with their motion, in the file that Python's `Take.write` makes. */

import { unzip } from "./archive";
import { floorSteps } from "./music/roll";
import { makeScore } from "./music/score";
import { CONTROL_TIMESTEP, InputError, MIN_PITCH, NUM_KEYS, type Note, type Piece, type Score } from "./types";

const FORMAT = 1;

type Numbers = Float64Array | Float32Array | Int32Array | Int8Array | Uint8Array;

/** Numbers of a NumPy file, row by row. */
interface Table {
  readonly shape: readonly number[];
  readonly data: Numbers;
}

/** A forearm of the page's slides along and across the keys. */
const FOREARM_JOINTS = 2;

/** The file's facts that the page needs. */
interface Header {
  readonly format: number;
  readonly title: string;
  readonly player: string;
  readonly control_timestep: number;
  readonly scene_options: {
    readonly reduced_action_space: boolean;
    readonly moving_keys: readonly [number, number];
    readonly sides: readonly string[];
    readonly hand: string;
    readonly forearm_dofs: readonly string[];
  };
}

/** The piece of a take as its file has it. */
interface WrittenScore {
  readonly title: string;
  readonly notes: readonly (Omit<Note, "hand"> & { readonly hand: "right" | "left" | null })[];
  readonly pedals: Score["pedals"];
}

/** A performance of T control steps by simulated hands. */
export interface Take {
  readonly title: string;
  readonly player: string;
  readonly steps: number;
  readonly roll: Piece["roll"];
  /** The piece, and when it begins, s; null in older takes. */
  readonly written: { readonly score: Score; readonly lead: number } | null;
  readonly scene: Header["scene_options"];
  /** (T, n) actions, the pedal's last. */
  readonly actions: Table;
  /** (T + 1, m) joint positions, rad or m; the columns `handColumns` are the hands', the others keys. */
  readonly qpos: Table;
  readonly handColumns: Numbers;
  /** (T, 88) keys that sounded at the end of each control step, 1 or 0. */
  readonly sounding: Uint8Array;
  /** Of each press, in the order of its first step and key: s, rad/s, s. */
  readonly strikeTime: Numbers;
  readonly strikeSpeed: Numbers;
  readonly releaseTime: Numbers;
}

/** @throws InputError If a file is no take of a piano, or not of the page's hands. */
export async function readTake(bytes: Uint8Array, name: string): Promise<Take> {
  const files = await unzip(bytes, name);
  try {
    const table = (key: string): Table => tableOf(files.get(`${key}.npy`), key);
    const header = JSON.parse(new TextDecoder().decode(table("header").data as Uint8Array)) as Header;
    if (header.format !== FORMAT) throw new Error(`its format is ${header.format}, not ${FORMAT}`);
    const actions = table("actions");
    const steps = actions.shape[0];
    const time = header.control_timestep;
    if (time !== CONTROL_TIMESTEP) throw new Error(`its control steps last ${time} s, not ${CONTROL_TIMESTEP}`);
    const scene = header.scene_options;
    if (scene.hand !== "shadow") throw new Error(`its hand is ${scene.hand}, not shadow`);
    if (scene.forearm_dofs.length !== FOREARM_JOINTS) throw new Error("its forearms have other joints");
    const onset = table("roll_onset").data.slice(0, steps * NUM_KEYS) as Uint8Array;
    const times = table("roll_onset_time").data;
    const struck = [...onset.keys()].filter((place) => onset[place] === 1);
    const written = files.has("score.npy") ? writtenIn(table("score"), table("roll_active").shape[0]) : null;
    return {
      title: header.title,
      player: header.player,
      steps,
      scene,
      written,
      roll: {
        controlTimestep: time,
        steps,
        active: table("roll_active").data.slice(0, steps * NUM_KEYS) as Uint8Array,
        finger: table("roll_finger").data.slice(0, steps * NUM_KEYS) as Int8Array,
        onset,
        sustain: table("roll_sustain").data.slice(0, steps) as Uint8Array,
        strikes: struck.map((place, i) => ({
          step: Math.floor(place / NUM_KEYS),
          key: place % NUM_KEYS,
          time: times[i],
        })),
      },
      actions,
      qpos: table("qpos"),
      handColumns: table("hand_qpos").data,
      sounding: table("performance_key_active").data as Uint8Array,
      strikeTime: table("performance_strike_time").data,
      strikeSpeed: table("performance_strike_speed").data,
      releaseTime: table("performance_release_time").data,
    };
  } catch (error) {
    throw new InputError(
      `“${name}” is no take for this page: ${(error as Error).message}. Expected performance.npz, which ` +
        "'sb3-piano play' writes.",
    );
  }
}

/** The piece of a take: what was due while it lasted. */
export function pieceOfTake(id: string, take: Take): Piece {
  const { roll, title, written } = take;
  if (written !== null) return { id, ...written, roll, warnings: [] };
  const step = roll.controlTimestep;
  const notes = roll.strikes.map((strike) => {
    const { key, time } = strike;
    let end = strike.step + 1;
    const goesOn = (at: number): boolean => roll.active[at] === 1 && roll.onset[at] === 0;
    while (end < roll.steps && goesOn(end * NUM_KEYS + key)) end++;
    const finger = roll.finger[strike.step * NUM_KEYS + key];
    return { pitch: key + MIN_PITCH, onset: time, offset: end * step, velocity: 80, finger, hand: null };
  });
  const duration = notes.reduce((last, note) => Math.max(last, note.offset), 0);
  return { id, score: { title, notes, pedals: [], duration }, roll, warnings: [], lead: null };
}

/** The score in a file, and when it begins in a roll of so many control steps, s. */
function writtenIn({ data }: Table, steps: number): Take["written"] {
  const { title, notes, pedals } = JSON.parse(new TextDecoder().decode(data as Uint8Array)) as WrittenScore;
  const sides = { right: 0, left: 1 } as const;
  const known = notes.map((note) => ({ ...note, hand: note.hand === null ? null : sides[note.hand] }));
  const score = makeScore(known, pedals, title);
  return { score, lead: (steps - 1 - floorSteps(score.duration, CONTROL_TIMESTEP)) * CONTROL_TIMESTEP };
}

/** Read an array of NumPy: its magic, a header in Python's syntax, then the numbers. */
function tableOf(bytes: Uint8Array | undefined, key: string): Table {
  if (bytes === undefined) throw new Error(`it has no ${key}`);
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint16(8, true);
  const text = new TextDecoder().decode(bytes.subarray(10, 10 + length));
  const kind = /'descr': '([^']+)'/.exec(text)?.[1];
  const shape = [...(/'shape': \(([^)]*)\)/.exec(text)?.[1] ?? "").matchAll(/\d+/g)].map(Number);
  if (/'fortran_order': True/.test(text)) throw new Error(`${key} is stored column by column`);
  // A copy, as the numbers need not be aligned in the file.
  const { buffer } = bytes.slice(10 + length);
  const data = numbersOf(kind, buffer, key);
  if (data.length !== shape.reduce((product, size) => product * size, 1)) throw new Error(`${key} is cut off`);
  return { shape, data };
}

function numbersOf(kind: string | undefined, buffer: ArrayBuffer, key: string): Numbers {
  switch (kind) {
    case "<f8":
      return new Float64Array(buffer);
    case "<f4":
      return new Float32Array(buffer);
    case "<i8":
      return Int32Array.from(new BigInt64Array(buffer), Number);
    case "<i4":
      return new Int32Array(buffer);
    case "|i1":
      return new Int8Array(buffer);
    case "|b1":
    case "|u1":
      return new Uint8Array(buffer);
    default:
      throw new Error(`${key} has numbers of the type ${kind}`);
  }
}
