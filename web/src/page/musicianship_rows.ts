import { musicianship, type Musicianship } from "../music/musicianship";
import type { KeyEvent, Session } from "../types";

/** What is shown, and how it is written. */
const ROWS: readonly (readonly [string, (found: Musicianship) => string])[] = [
  ["Note F1 with velocity", (found) => number(found.note_velocity_f1)],
  ["Correlation of velocities", (found) => number(found.velocity_correlation)],
  ["Chord spread", (found) => time(found.chord_spread_ms)],
  ["Melody lead", (found) => time(found.melody_lead_ms)],
  ["Timing, right hand", (found) => late(found.onset_error_mean_right_ms, found.onset_error_std_right_ms)],
  ["Timing, left hand", (found) => late(found.onset_error_mean_left_ms, found.onset_error_std_left_ms)],
  ["Held share", ({ duration_ratio: share }) => known(share, `${Math.round(100 * share)} %`)],
  ["Legato overlap", (found) => time(found.legato_overlap_ms)],
];

/** The fold with the numbers of a musician; they are found only while it is open. */
export class MusicianshipRows {
  private readonly values: readonly HTMLElement[];

  constructor(
    private readonly fold: HTMLDetailsElement,
    list: HTMLElement,
    onOpen: () => void,
  ) {
    this.values = ROWS.map(([name]) => {
      const value = document.createElement("dd");
      const row = document.createElement("div");
      row.append(Object.assign(document.createElement("dt"), { textContent: name }), value);
      list.append(row);
      return value;
    });
    fold.addEventListener("toggle", onOpen);
  }

  /** Show what a session has come to; null for one that has not begun. */
  show(session: Session | null, events: readonly KeyEvent[]): void {
    if (!this.fold.open) return;
    const found = session === null ? null : musicianship(session.piece, events, session.stepsPlayed);
    this.values.forEach((value, i) => (value.textContent = found === null ? "–" : ROWS[i]![1](found)));
  }
}

function known(value: number, text: string): string {
  return Number.isNaN(value) ? "–" : text.replace("-", "−");
}

function number(value: number): string {
  return known(value, value.toFixed(3));
}

function time(ms: number): string {
  return known(ms, `${Math.round(ms) || 0} ms`);
}

function late(mean: number, spread: number): string {
  return known(mean, `${Math.abs(Math.round(mean))} ms ${mean < 0 ? "early" : "late"}, ± ${Math.round(spread)} ms`);
}
