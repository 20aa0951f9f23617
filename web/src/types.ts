/** What the rooms of the page hand to each other. Words and units are those of the Python package. */

/** Keys of the piano, from A0 (pitch 21) to C8. */
export const NUM_KEYS = 88;
export const MIN_PITCH = 21;
/** Length of a control step, s. */
export const CONTROL_TIMESTEP = 0.05;
/** Finger of a note of which none is known; otherwise 0-4 are the right hand's, thumb to little, 5-9 the left's. */
export const UNKNOWN_FINGER = -1;

/** A note of a score; times in s. */
export interface Note {
  readonly pitch: number;
  readonly onset: number;
  readonly offset: number;
  /** MIDI velocity, 1 to 127. */
  readonly velocity: number;
  readonly finger: number;
  /** 0 right, 1 left, null if unknown. */
  readonly hand: 0 | 1 | null;
}

/** A time during which the sustain pedal is down, s. */
export interface Pedal {
  readonly onset: number;
  readonly offset: number;
}

/** A piece. Immutable; notes are ordered as in Python's `Score`. */
export interface Score {
  readonly title: string;
  readonly notes: readonly Note[];
  readonly pedals: readonly Pedal[];
  /** s. */
  readonly duration: number;
}

/** A strike of a roll: control step, key (0-87), time in s. */
export interface Strike {
  readonly step: number;
  readonly key: number;
  readonly time: number;
}

/** A score cut into control steps, as Python's `PianoRoll`; arrays are (steps, 88), row by row. */
export interface PianoRoll {
  readonly controlTimestep: number;
  readonly steps: number;
  /** 1 where a key should be down. */
  readonly active: Uint8Array;
  /** The finger of the note that sounds, -1 where there is none. */
  readonly finger: Int8Array;
  /** 1 at the first active step of each strike. */
  readonly onset: Uint8Array;
  /** (steps) 1 where the sustain pedal should be down. */
  readonly sustain: Uint8Array;
  /** Ordered by step, then key. */
  readonly strikes: readonly Strike[];
}

/** A piece that is ready to be played: the score as it is written, with the fingers that play it, and its roll. */
export interface Piece {
  /** What permalinks and menus call it. */
  readonly id: string;
  readonly score: Score;
  readonly roll: PianoRoll;
  /** Notes that are not played as written, in words, for the reader. */
  readonly warnings: readonly string[];
  /** When the score begins in the episode, s; null if its notes are only those of the roll. */
  readonly lead: number | null;
}

/** Bad input: one clear message that names the value, what was expected and what to do. */
export class InputError extends Error {}

/** Files that come with the page, by the names that `sb3-piano export web` gives them. */
export interface Assets {
  bytes(name: string): Promise<Uint8Array>;
  json<T>(name: string): Promise<T>;
}

/** Who plays. `score` lets the hands rest and sounds the score itself; `you` is a MIDI or computer keyboard. */
export type PlayerId = "sight-reader" | "planned" | "recorded" | "score" | "you";

/** What has been played so far, by the definitions of Python's `sb3_piano.metrics`. */
export interface Metrics {
  readonly f1: number;
  readonly precision: number;
  readonly recall: number;
  readonly onset_f1: number;
  /** Share of the notes whose key is struck within 50 ms of their onset. */
  readonly onset_recall: number;
}

/** Moving parts of the scene, for who draws, hears or pulls them; arrays are fresh views after each control step. */
export interface SceneState {
  /** (88) key angle over its largest angle, 0 to 1. */
  readonly keyState: Float64Array;
  /** (88) 1 where a key sounds. */
  readonly sounding: Uint8Array;
  /** (bodies, 3) positions, m, and (bodies, 4) quaternions w x y z, in the order of `bodyNames`. */
  readonly bodyPositions: Float64Array;
  readonly bodyQuaternions: Float64Array;
  readonly bodyNames: readonly string[];
}

/** A key that began or ceased to sound, to the length of a physics step. */
export interface KeyEvent {
  readonly key: number;
  readonly down: boolean;
  /** s from the start of the episode. */
  readonly time: number;
  /** Speed of the key as it passes its sounding angle, rad/s: what loudness is made of. */
  readonly speed: number;
}

/** One piece, played by one player, control step by control step. */
export interface Session {
  readonly piece: Piece;
  readonly player: PlayerId;
  readonly state: SceneState;
  readonly stepsPlayed: number;
  readonly finished: boolean;
  /** Play one control step; return the keys that moved past their sounding angle in it, in order. */
  step(): readonly KeyEvent[];
  /** Begin again, from the same state. */
  restart(): void;
  metrics(): Metrics;
  /** (steps played, 88) which keys sounded at the end of each control step, row by row. */
  played(): Uint8Array;
  /** Pull a body by a force at a point (world frame, N, m) until told otherwise; null lets go. */
  pull(body: string | null, force?: readonly [number, number, number], at?: readonly [number, number, number]): void;
  /** Push a key down with a finger from outside, or let go. */
  pushKey(key: number, down: boolean): void;
  /** Standard deviation of noise on actions, as a share of a joint's range; control steps by which actions come late. */
  noise: number;
  latency: number;
}

/** What `sb3-piano export web` writes beside the files: the pieces, and what of each player there is. */
export interface Catalogue {
  readonly version: string;
  readonly pieces: readonly CataloguePiece[];
}

export interface CataloguePiece {
  readonly id: string;
  readonly title: string;
  readonly composer: string;
  /** A MIDI file among the assets, with what Python's fingering found as a JSON `Score` beside it. */
  readonly midi?: string;
  readonly score?: string;
  /** Files of a plan and of a take among the assets, if there are any. Without a score, the piece is the take's. */
  readonly plan?: string;
  readonly recording?: string;
  /** Who plays on the recording. */
  readonly recorder?: string;
  /** Takes of its beginning, to be compared by ear. */
  readonly versions?: readonly CataloguePiece[];
  /** What Python measured, by player. */
  readonly expected: Readonly<Partial<Record<PlayerId, Pick<Metrics, "f1" | "onset_f1" | "onset_recall">>>>;
}
