/** The observation of hands that have read the piece: each sees itself as a right hand. */

import { FINGERS_PER_HAND, KEY_IS_BLACK } from "../music/constants";
import type { HandShape, ReadingFacts } from "../reading/facts";
import { type HandReading, type Reading, readPiece } from "../reading/piece";
import type { SceneFacts } from "../simulation/facts";
import type { Simulation } from "../simulation/simulation";
import { NUM_KEYS, type PianoRoll } from "../types";
import { FingerPresses } from "./hand_encoding_presses";

/** Version of what is observed, Python's: networks belong to one. */
export const HANDS_VERSION = 1;

/** States after the present one of which is shown: key frames, where the arm is wanted, ... */
const FRAMES_AHEAD = [1, 2, 3, 4, 6, 8];
const PLACES_AHEAD = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32];
/** ... whether the hand plays about then, how far the arm may go. */
const BUSY_AHEAD = [1, 6, 16];
const LINE_AHEAD = [1, 4, 8, 16];
/** Presses of each finger that are shown: the one under way or else the next, and that after it. */
const PRESSES_AHEAD = 2;
const PRESS_NUMBERS = 13;
/** Numbers of a hand's blocks from "frames" on. */
const AFTER_TIPS =
  FINGERS_PER_HAND * (FRAMES_AHEAD.length * 4 + PRESSES_AHEAD * PRESS_NUMBERS + 10) +
  PLACES_AHEAD.length +
  BUSY_AHEAD.length +
  LINE_AHEAD.length +
  1;

/** The farthest that presses are seen ahead and back, s. */
const MOST_TIME = 2;
const DM_PER_M = 10; // so that the last centimetre counts among numbers of the order of 1
const CM_PER_M = 100;
/** Of a key frame across the keys, per m. */
const FULL_WEIGHT = 10;
/** rad/s, or m/s. */
const FASTEST = 50;
/** Keys around a finger that are shown, from the thumb's side. */
const AROUND = [-1, 0, 1];
/** Of the table of keys by place, m. */
const GRID = 1e-3;

/** What of the simulation is looked at. */
export type ObservedState = Pick<Simulation, "qpos" | "qvel" | "geomXpos" | "geomXmat" | "keyState">;

/** A hand, and where MuJoCo keeps its state. */
interface Hand extends HandShape {
  /** (m) addresses of its joints in qpos and in qvel, wrist to thumb, then the sliders. */
  readonly qpos: readonly number[];
  readonly dof: readonly number[];
  /** (5) geoms of the last finger links, thumb to little finger. */
  readonly tipGeoms: readonly number[];
}

/** What each hand read in the piece, relative to its arm and its fingers. */
export class HandEncoding {
  /** Length of an observation: both hands, the right one first. */
  readonly size: number;
  private readonly hands: readonly Hand[];
  private readonly nearest: Uint8Array;
  private reading: Reading | null = null;
  private presses: readonly FingerPresses[] = [];

  constructor(
    private readonly facts: ReadingFacts,
    scene: SceneFacts,
  ) {
    this.hands = facts.hands.map((shape, side) => ({
      ...shape,
      qpos: scene.hands[side].qpos,
      dof: scene.hands[side].dof,
      tipGeoms: scene.fingertipGeom.slice(side * FINGERS_PER_HAND, (side + 1) * FINGERS_PER_HAND),
    }));
    this.size = 2 * (2 * this.hands[0].qpos.length + 3 * FINGERS_PER_HAND + AFTER_TIPS);
    this.nearest = keysByPlace(facts.keys.y);
  }

  /** Take a piece of which no hand plays the notes without finger. */
  read(roll: PianoRoll): Reading {
    const reading = readPiece(roll, this.facts);
    this.presses = reading.hands.map((hand) => new FingerPresses(hand, reading.roll));
    this.reading = reading;
    return reading;
  }

  /**
   * The observation before a control step, (size).
   *
   * @throws Error If no piece has been read.
   */
  write(step: number, state: ObservedState): Float32Array {
    const reading = this.reading;
    if (reading === null) throw new Error("No piece has been read: call read before write.");
    const now = Math.min(step, reading.roll.steps - 1);
    const observation = new Float32Array(this.size);
    const arms = this.hands.map((hand) => this.arm(hand, state));
    this.hands.forEach((hand, side) => {
      const out = new Writer(observation, side * (this.size / 2));
      const tips = fingertips(hand, state);
      const shown = reading.hands[side];
      this.writeBody(out, hand, state, tips, arms[side]);
      writeFrames(out, hand, shown, now, tips);
      this.writePresses(out, side, now, state, tips);
      this.writeKeys(out, hand, reading.roll, now, state, tips);
      writeWay(out, hand, shown, now, arms[side]);
      out.put(arms[side] + arms[1 - side]);
    });
    return observation;
  }

  /** How far out on its own side an arm is, dm: both are as far out where their sliders are at 0. */
  private arm(hand: Hand, { qpos }: ObservedState): number {
    const slider = hand.sign * qpos[hand.qpos[this.facts.slider]];
    return (this.hands[0].middle + this.facts.slope * slider) * DM_PER_M;
  }

  /** Joint positions and velocities, and fingertips from the arm. */
  private writeBody(
    out: Writer,
    hand: Hand,
    { qpos, qvel }: ObservedState,
    tips: Float64Array,
    arm: number,
  ): void {
    const mirror = (joint: number) => (joint === this.facts.slider ? hand.sign : 1);
    hand.qpos.forEach((address, joint) => out.put(qpos[address] * mirror(joint)));
    hand.dof.forEach((address, joint) => out.put(clip(qvel[address] * mirror(joint), FASTEST)));
    tips.forEach((place, i) => out.put(place * DM_PER_M - (i % 3 === 1 ? arm : 0)));
  }

  /** Each finger's press under way or else the next, then the one after it. */
  private writePresses(
    out: Writer,
    side: number,
    step: number,
    { keyState }: ObservedState,
    tips: Float64Array,
  ): void {
    const { roll, hands } = this.reading as Reading;
    const { controlTimestep } = roll;
    const time = step * controlTimestep;
    const until = (state: number) => clip((state - step) * controlTimestep, MOST_TIME);
    for (let ahead = 0; ahead < PRESSES_AHEAD; ahead++) {
      for (let finger = 0; finger < FINGERS_PER_HAND; finger++) {
        const press = this.presses[side].find(finger, step, ahead);
        if (press === undefined) {
          out.skip(PRESS_NUMBERS);
          continue;
        }
        const { timed, point, onset, offset } = press;
        const { sign } = this.hands[side];
        putWay(out, hands[side].frames.target, point, tips, finger, sign);
        out.put(keyState[timed.press.key], until(timed.first), until(timed.last), 1);
        out.put(KEY_IS_BLACK[timed.press.key] ? 1 : 0);
        out.put(timed.leapt ? 1 : 0, timed.leaps ? 1 : 0, timed.repeated ? 1 : 0);
        out.put(clip(onset - time, MOST_TIME), clip(offset - time, MOST_TIME));
      }
    }
  }

  /** What the keys around each finger do, and whether they should. */
  private writeKeys(
    out: Writer,
    { sign }: HandShape,
    { active }: PianoRoll,
    step: number,
    { keyState }: ObservedState,
    tips: Float64Array,
  ): void {
    const { y } = this.facts.keys;
    const due = active.subarray(step * NUM_KEYS, (step + 1) * NUM_KEYS);
    for (let finger = 0; finger < FINGERS_PER_HAND; finger++) {
      const across = tips[3 * finger + 1] * sign; // in the world
      const cell = Math.trunc((across - y[0]) * (1 / GRID));
      const key = this.nearest[Math.min(Math.max(cell, 0), this.nearest.length - 1)];
      const around = AROUND.map((way) => key + way * sign); // beyond both ends there is nothing
      for (const one of around) out.put(keyState[one] ?? 0);
      for (const one of around) out.put(due[one] ?? 0);
      for (const one of around) out.put(KEY_IS_BLACK[one] ? 1 : 0);
      out.put(CM_PER_M * (y[key] - across) * sign);
    }
  }
}

/** Numbers written one after the other. */
class Writer {
  constructor(
    private readonly to: Float32Array,
    private at: number,
  ) {}

  put(...numbers: number[]): void {
    for (const number of numbers) this.to[this.at++] = number;
  }

  /** Leave so many numbers at 0. */
  skip(count: number): void {
    this.at += count;
  }
}

/** For the next states and each finger: the way to where its tip is wanted, and how much that counts. */
function writeFrames(
  out: Writer,
  { sign }: HandShape,
  { frames }: HandReading,
  step: number,
  tips: Float64Array,
): void {
  for (const ahead of FRAMES_AHEAD) {
    const state = Math.min(step + ahead, frames.states - 1);
    for (let finger = 0; finger < FINGERS_PER_HAND; finger++) {
      const at = state * FINGERS_PER_HAND + finger;
      const weight = frames.weight[at];
      if (weight > 0) putWay(out, frames.target, 3 * at, tips, finger, sign);
      else out.skip(3);
      out.put(weight / FULL_WEIGHT);
    }
  }
}

/** Where the hand is wanted, whether it plays about then, and how far the arm may go. */
function writeWay(
  out: Writer,
  { sign }: HandShape,
  { place, busy, bound }: HandReading,
  step: number,
  arm: number,
): void {
  const scale = DM_PER_M * sign;
  const at = (ahead: number) => Math.min(step + ahead, place.length - 1);
  // As in Python, where places are kept in float32 before the arm's is known.
  for (const ahead of PLACES_AHEAD) out.put(Math.fround(scale * place[at(ahead)]) - arm);
  for (const ahead of BUSY_AHEAD) out.put(busy[at(ahead)]);
  for (const ahead of LINE_AHEAD) out.put(Math.fround(scale * bound[at(ahead)]) - arm);
}

/** The way of a finger from where it is to one of some points, dm, in the hand's mirror. */
function putWay(
  out: Writer,
  points: Float64Array,
  at: number,
  tips: Float64Array,
  finger: number,
  sign: number,
): void {
  for (let axis = 0; axis < 3; axis++) {
    const wanted = points[at + axis] * (axis === 1 ? sign : 1);
    out.put(wanted * DM_PER_M - tips[3 * finger + axis] * DM_PER_M);
  }
}

/** Centres of a hand's fingertips, (5, 3) m; the left hand's in the mirror, in which y changes its sign. */
function fingertips(hand: Hand, { geomXpos, geomXmat }: ObservedState): Float64Array {
  const tips = new Float64Array(3 * FINGERS_PER_HAND);
  hand.tipGeoms.forEach((geom, finger) => {
    for (let axis = 0; axis < 3; axis++) {
      const along = geomXmat[9 * geom + 3 * axis + 2]; // of the capsule's own axis
      const place = geomXpos[3 * geom + axis] + along * hand.tipAlong[finger];
      tips[3 * finger + axis] = axis === 1 ? place * hand.sign : place;
    }
  });
  return tips;
}

/** The nearest key for each millimetre across the keyboard, from the first key's centre to the last one's. */
function keysByPlace(places: readonly number[]): Uint8Array {
  const lowest = places[0];
  const cells = Math.ceil((places[places.length - 1] - lowest) / GRID);
  return Uint8Array.from({ length: cells }, (_, cell) => {
    const place = lowest + cell * GRID + GRID / 2;
    let nearest = 0;
    places.forEach((key, i) => {
      if (Math.abs(place - key) < Math.abs(place - places[nearest])) nearest = i;
    });
    return nearest;
  });
}

function clip(value: number, most: number): number {
  return Math.min(Math.max(value, -most), most);
}
