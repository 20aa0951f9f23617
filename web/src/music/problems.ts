/** Notes of a piece that the hands cannot play as written, in words. */

import { MIN_PITCH, NUM_KEYS, UNKNOWN_FINGER } from "../types";
import { fingerName, pitchName } from "./constants";
import type { EarlyRelease, HeldRoll } from "./fingering/releases";

const MOST_NAMED = 5;

/** A note that cannot be played as it is written. */
export interface Problem {
  readonly key: number;
  /** Its first control step. */
  readonly step: number;
  /** The finger that has it, 0 to 9, of a note that is let go as it is written; -1 for none. */
  readonly finger: number;
  readonly reason: string;
}

/** Return the notes that no finger holds as written, in order of time: without finger, let go early, left out. */
export function unheld(roll: HeldRoll): Problem[] {
  return [...fingerless(roll), ...released(roll)].sort((a, b) => a.step - b.step);
}

/** Return problems in words, the first ones by name; `controlTimestep` in s. */
export function summary(problems: readonly Problem[], controlTimestep: number): string {
  const counts = new Map<string, number>();
  for (const { reason } of problems) {
    const kind = reason.split(" by ")[0]!;
    counts.set(kind, (counts.get(kind) ?? 0) + 1);
  }
  const counted = [...counts].map(([kind, count]) => `${count} x ${kind}`).join(", ");
  const named = problems.slice(0, MOST_NAMED).map((problem) => inWords(problem, controlTimestep));
  const more = problems.length > MOST_NAMED ? `; and ${problems.length - MOST_NAMED} more` : "";
  const notes = problems.length === 1 ? "1 note" : `${problems.length} notes`;
  return `${notes} cannot be played as written (${counted}): ${named.join("; ")}${more}.`;
}

function inWords({ key, step, finger, reason }: Problem, controlTimestep: number): string {
  const who = finger === UNKNOWN_FINGER ? "" : `, ${fingerName(finger)}`;
  const pitch = MIN_PITCH + key;
  const time = (step * controlTimestep).toFixed(2);
  return `${pitchName(pitch)} (pitch ${pitch}) at ${time} s${who}: ${reason}`;
}

function fingerless(roll: HeldRoll): Problem[] {
  const leftOut = new Set(roll.earlyReleases.map((one) => one.release * NUM_KEYS + one.key));
  return roll.strikes
    .map(({ step, key }) => ({ step, key, at: step * NUM_KEYS + key }))
    .filter(({ at }) => roll.finger[at] === UNKNOWN_FINGER && !leftOut.has(at))
    .map(({ step, key }) => ({ key, step, finger: UNKNOWN_FINGER, reason: "no finger is left for it" }));
}

function released(roll: HeldRoll): Problem[] {
  return roll.earlyReleases
    .filter(({ onset, release, offset }) => !(onset < release && release === offset - 1)) // rounding, nobody hears it
    .map((one) => ({ key: one.key, step: one.onset, finger: one.finger, reason: whyReleased(one, roll) }));
}

function whyReleased({ onset, release, offset, forKey }: EarlyRelease, roll: HeldRoll): string {
  const instead = pitchName(MIN_PITCH + forKey);
  if (release <= onset) return `left out by the hand, which plays ${instead}`;
  return `let go early by ${((offset - release) * roll.controlTimestep).toFixed(2)} s for ${instead}`;
}
