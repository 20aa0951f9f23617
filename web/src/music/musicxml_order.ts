import type { XmlElement } from "./xml";

const QUARTERS_PER_MINUTE = 120;
const MOST_TIMES = 20;
const EQUAL = 1e-6;

/** An ending: the turns in which it is played. */
interface Ending {
  numbers: readonly number[];
}

interface Measure {
  readonly start: number;
  readonly end: number;
  readonly isBegin: boolean;
  readonly times: number;
  ending: Ending | null;
}

/** Return when what is written from one quarter note to another is played, s: once, or for each repeat. */
export interface Timeline {
  (start: number, end: number): [number, number][];
  /** Last quarter note. */
  readonly end: number;
}

/** Measures of all parts, with their tempo and their repeats. */
export class Measures {
  /** Whether there are jumps, which are not followed. */
  hasJumps = false;
  private readonly tempos = new Map<number, { readonly tempo: number; readonly isSaid: boolean }>();
  private readonly done: Measure[] = [];
  private isBegin = false;
  private times = 1;
  private ending: Ending | null = null;
  private ends = false;

  /** Quarter note at which the next measure begins. */
  get end(): number {
    return this.done.at(-1)?.end ?? 0;
  }

  /** Add a tempo, quarter notes a minute; one that is said to programs is preferred to a printed one. */
  addTempo(at: number, tempo: number, isSaid: boolean): void {
    if (isSaid || this.tempos.get(at)?.isSaid !== true) this.tempos.set(at, { tempo, isSaid });
  }

  /** Add a bar line of the measure that is being read. */
  addBarline(element: XmlElement): void {
    const repeat = element.first("repeat");
    if (repeat?.attribute("direction") === "forward") this.isBegin = true;
    if (repeat?.attribute("direction") === "backward") {
      this.times = Math.min(MOST_TIMES, Number(repeat.attribute("times")) || 2);
    }
    const ending = element.first("ending");
    if (ending?.attribute("type") === "start") {
      this.ending = { numbers: numbersOf(ending.attribute("number") || ending.text) };
    } else if (ending) {
      this.ends = true;
    }
  }

  /** End a measure. */
  close(end: number): void {
    this.done.push({ start: this.end, end, isBegin: this.isBegin, times: this.times, ending: this.ending });
    [this.isBegin, this.times] = [false, 1];
    if (this.ends) [this.ending, this.ends] = [null, false];
  }

  timeline(): Timeline {
    const seconds = this.seconds();
    const shifts = this.done.map((): number[] => []);
    let now = 0;
    for (const index of this.order()) {
      const { start, end } = this.done[index];
      shifts[index].push(now - seconds(start));
      now += seconds(end) - seconds(start);
    }
    const line = (start: number, end: number): [number, number][] => {
      const after = this.done.findIndex((measure) => measure.end > start + EQUAL);
      const index = after < 0 ? this.done.length - 1 : after;
      return shifts[index].map((shift) => [seconds(start) + shift, seconds(end) + shift]);
    };
    return Object.assign(line, { end: this.end });
  }

  /** Return the measures in the order of playing. */
  private order(): number[] {
    this.numberEndings();
    const order: number[] = [];
    let [begin, turn] = [0, 1];
    let index = 0;
    while (index < this.done.length) {
      const { isBegin, times, ending } = this.done[index];
      if (isBegin && index !== begin) [begin, turn] = [index, 1];
      const isPlayed = ending === null || ending.numbers.includes(turn);
      if (isPlayed) order.push(index);
      const last = ending === null ? times : this.lastTurn(index);
      if (times > 1 && isPlayed && turn < last) {
        turn++;
        index = begin;
        continue;
      }
      index++;
      // A repeat that is over ends with its last ending.
      const isOver = times > 1 || ending !== null;
      if (isOver && turn >= last && (this.done[index]?.ending ?? null) === null) [begin, turn] = [index, 1];
    }
    return order;
  }

  /** Return the measures around one that have endings, one after the other. */
  private group(index: number): Measure[] {
    let [first, after] = [index, index];
    while (this.done[first]?.ending) first--;
    while (this.done[after]?.ending) after++;
    return this.done.slice(first + 1, after);
  }

  /** Return the last turn of the endings around a measure; a lone ending is left out in one more. */
  private lastTurn(index: number): number {
    const endings = new Set(this.group(index).map((measure) => measure.ending!));
    return Math.max(...[...endings].flatMap((ending) => ending.numbers)) + (endings.size === 1 ? 1 : 0);
  }

  /** Number endings in their order unless their own numbers fit; those without a repeat are no endings. */
  private numberEndings(): void {
    for (let index = 0; index < this.done.length; index++) {
      const group = this.group(index);
      const endings = [...new Set(group.map((measure) => measure.ending!))];
      const numbers = endings.flatMap((ending) => ending.numbers).sort((a, b) => a - b);
      if (!group.some((measure) => measure.times > 1)) {
        for (const measure of group) measure.ending = null;
      } else if (!endings[0].numbers.includes(1) || numbers.some((number, i) => number !== i + 1)) {
        let next = 1;
        for (const ending of endings) {
          ending.numbers = Array.from({ length: Math.max(1, ending.numbers.length) }, () => next++);
        }
      }
      index += group.length;
    }
  }

  private seconds(): (at: number) => number {
    const corners = [...this.tempos].sort((a, b) => a[0] - b[0]);
    return (at) => {
      let [time, last, tempo] = [0, 0, QUARTERS_PER_MINUTE];
      for (const [corner, mark] of corners) {
        if (corner >= at) break;
        time += ((corner - last) * 60) / tempo;
        [last, tempo] = [corner, mark.tempo];
      }
      return time + ((at - last) * 60) / tempo;
    };
  }
}

/** Numbers of an ending, such as "1, 2" or "1-3". */
function numbersOf(text: string): number[] {
  return [...text.matchAll(/(\d+)(?:\.?\s*[-–—]\s*(\d+))?/g)].flatMap(([, first, last]) => {
    const length = Math.min(MOST_TIMES, Number(last ?? first)) - Number(first) + 1;
    return Array.from({ length: Math.max(0, length) }, (_, i) => Number(first) + i);
  });
}
