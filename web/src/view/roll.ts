import { KEY_IS_BLACK } from "../music/constants";
import { NUM_KEYS } from "../types";
import { MISSED_COLOR, MISTIMED_COLOR, PRESSED_COLOR, WRONG_COLOR, css, fingerColor, type Rgb } from "./colors";
import type { RollNote } from "./roll_notes";

/** What became of a note that is due, as far as has been played. */
export type Fate = "due" | "hit" | "mistimed" | "missed";

/** A press that was played, s; `wrong` if its key was due in none of it. */
export interface RollPress {
  readonly key: number;
  readonly onset: number;
  /** null while the key is still down. */
  readonly offset: number | null;
  readonly wrong: boolean;
}

/** What the piano roll shows. */
export interface RollContent {
  readonly notes: readonly RollNote[];
  /** One for each note. */
  readonly fates: readonly Fate[];
  readonly presses: readonly RollPress[];
  readonly controlTimestep: number;
  /** s. */
  readonly duration: number;
}

/** Time in sight, s: for each 100 pixels of width, and at least. */
const SECONDS_PER_100_PIXELS = 1.1;
const LEAST_SECONDS = 5;
/** Share of the width that shows what is over. */
const PAST = 0.36;
/** Keys above and below those of the piece. */
const MARGIN = 2;
const FIRST_C = 3;

const FATE_COLORS: Readonly<Record<Exclude<Fate, "due">, Rgb>> = {
  hit: PRESSED_COLOR,
  mistimed: MISTIMED_COLOR,
  missed: MISSED_COLOR,
};

/** The piano roll on a canvas: time from left to right, now at a line, what is due and what was played. */
export class RollView {
  private readonly context: CanvasRenderingContext2D;
  private width = 0;
  private height = 0;
  private content: RollContent | null = null;
  private low = 0;
  private high = NUM_KEYS - 1;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.context = canvas.getContext("2d")!;
  }

  /** Fit the drawing to its place on the page, in CSS pixels. */
  resize(width: number, height: number, pixelRatio: number): void {
    this.canvas.width = Math.round(width * pixelRatio);
    this.canvas.height = Math.round(height * pixelRatio);
    this.context.setTransform(pixelRatio, 0, 0, pixelRatio, 0, 0);
    this.width = width;
    this.height = height;
  }

  /** Show other notes or presses from the next drawing on. */
  show(content: RollContent): void {
    if (content.notes !== this.content?.notes) {
      const keys = content.notes.map((note) => note.key);
      this.low = Math.max(0, Math.min(NUM_KEYS - 1, ...keys) - MARGIN);
      this.high = Math.min(NUM_KEYS - 1, Math.max(0, ...keys) + MARGIN);
      if (keys.length === 0) [this.low, this.high] = [0, NUM_KEYS - 1];
    }
    this.content = content;
  }

  /** Draw a time, s. */
  draw(time: number): void {
    const { context, content, width, height } = this;
    context.clearRect(0, 0, width, height);
    if (content === null || width === 0) return;
    const seconds = Math.max(LEAST_SECONDS, (width / 100) * SECONDS_PER_100_PIXELS);
    const start = time - PAST * seconds;
    const x = (at: number): number => ((at - start) / seconds) * width;
    this.drawKeys();
    this.drawNotes(content, x);
    this.drawPresses(content, x, time);
    context.fillStyle = "rgb(255 255 255 / 0.85)";
    context.fillRect(x(time) - 0.75, 0, 1.5, height);
  }

  private drawKeys(): void {
    const { context, width } = this;
    for (let key = this.low; key <= this.high; key++) {
      if (KEY_IS_BLACK[key]) {
        context.fillStyle = "rgb(255 255 255 / 0.025)";
        context.fillRect(0, this.top(key), width, this.row);
      }
      if ((key - FIRST_C) % 12 === 0) {
        context.fillStyle = "rgb(255 255 255 / 0.14)";
        context.fillRect(0, this.top(key) + this.row - 0.5, width, 1);
      }
    }
  }

  private drawNotes(content: RollContent, x: (time: number) => number): void {
    content.notes.forEach((note, i) => {
      const left = x(note.first * content.controlTimestep);
      const right = x(note.end * content.controlTimestep);
      if (right < 0 || left > this.width) return;
      const fate = content.fates[i];
      if (fate === "missed") {
        this.outline(note.key, left, right, css(fingerColor(note.finger), 0.75));
      } else {
        const color = fate === "due" ? fingerColor(note.finger) : FATE_COLORS[fate];
        this.bar(note.key, left, right, css(color, fate === "due" ? 0.92 : 0.8), 1);
      }
    });
  }

  private drawPresses(content: RollContent, x: (time: number) => number, time: number): void {
    for (const press of content.presses) {
      const left = x(press.onset);
      const right = x(press.offset ?? time);
      if (right < 0 || left > this.width) continue;
      if (press.wrong) this.bar(press.key, left, right, css(WRONG_COLOR), 1);
      // What was played lies as a light line within what was due.
      else this.bar(press.key, left, right, "rgb(255 255 255 / 0.75)", 0.24);
    }
  }

  private bar(key: number, left: number, right: number, color: string, share: number): void {
    const row = this.row;
    const height = Math.max(1, (row - Math.min(1, 0.15 * row)) * share);
    this.context.fillStyle = color;
    this.context.beginPath();
    const width = Math.max(1.5, right - left - 1);
    this.context.roundRect(left, this.top(key) + (row - height) / 2, width, height, Math.min(2.5, height / 2));
    this.context.fill();
  }

  private outline(key: number, left: number, right: number, color: string): void {
    this.context.strokeStyle = color;
    this.context.lineWidth = 1;
    this.context.beginPath();
    const height = Math.max(1.5, this.row - 1.5);
    const top = this.top(key) + (this.row - height) / 2;
    this.context.roundRect(left + 0.5, top, Math.max(1.5, right - left - 2), height, Math.min(2.5, height / 2));
    this.context.stroke();
  }

  private get row(): number {
    return this.height / (this.high - this.low + 1);
  }

  private top(key: number): number {
    return (this.high - key) * this.row;
  }
}
