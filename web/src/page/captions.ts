import { fingerName, pitchName } from "../music/constants";
import { MIN_PITCH, NUM_KEYS, UNKNOWN_FINGER, type Metrics, type Session } from "../types";

/** A share in words: "96 %". Only all is 100 %. */
export function percent(share: number): string {
  return `${share < 1 ? Math.min(99, Math.round(100 * share)) : 100} %`;
}

/** Figures in words: "96 % of the notes right, F1 0.93, onset F1 0.95". */
export function figures(metrics: Metrics): string {
  return `${percent(metrics.onset_recall)} of the notes right, F1 ${metrics.f1.toFixed(2)}, onset F1 ${metrics.onset_f1.toFixed(2)}`;
}

/** Minutes and seconds: "1:05". */
export function clock(seconds: number): string {
  const whole = Math.floor(seconds + 1e-6);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** What the picture shows at a control step: keys that are due with their fingers, and keys that sound. */
export function describe(session: Session): string {
  const { roll } = session.piece;
  const step = Math.max(0, session.stepsPlayed - 1);
  const due: string[] = [];
  const right: string[] = [];
  const wrong: string[] = [];
  for (let key = 0; key < NUM_KEYS; key++) {
    const at = step * NUM_KEYS + key;
    const name = pitchName(key + MIN_PITCH);
    const asked = step < roll.steps && roll.active[at] === 1;
    const finger = roll.finger[at];
    if (asked) due.push(finger === UNKNOWN_FINGER ? name : `${name} (${fingerName(finger)})`);
    if (session.state.sounding[key] === 1) (asked ? right : wrong).push(name);
  }
  const parts = [`Due: ${listed(due)}`, `sounding: ${listed(right)}`];
  if (wrong.length > 0) parts.push(`wrong: ${listed(wrong)}`);
  return `${parts.join("; ")}.`;
}

function listed(names: readonly string[]): string {
  return names.length === 0 ? "nothing" : names.join(", ");
}
