/** Making scores: the order of notes, pedals that touch, silence before the first note. */

import { UNKNOWN_FINGER, type Note, type Pedal, type Score } from "../types";
import { FINGERS_PER_HAND } from "./constants";

/** Return a score with its notes and pedals in order; a finger that is known decides on the hand. */
export function makeScore(notes: readonly Note[], pedals: readonly Pedal[], title: string): Score {
  const sorted = notes.map(withHandOfFinger).sort(noteOrder);
  const duration = sorted.reduce((last, note) => Math.max(last, note.offset), 0);
  return { title, notes: sorted, pedals: mergePedals(pedals), duration };
}

/** Return the score with other notes. */
export function withNotes(score: Score, notes: readonly Note[]): Score {
  return makeScore(notes, score.pedals, score.title);
}

/** Return the piece moved so that its first note starts at 0 s. */
export function trimSilence(score: Score): Score {
  const start = score.notes[0]!.onset;
  const notes = score.notes.map((note) => ({
    ...note,
    onset: note.onset - start,
    offset: note.offset - start,
  }));
  const pedals = score.pedals
    .filter((pedal) => pedal.offset > start)
    .map(({ onset, offset }) => ({ onset: Math.max(onset, start) - start, offset: offset - start }));
  return makeScore(notes, pedals, score.title);
}

function withHandOfFinger(note: Note): Note {
  if (note.finger === UNKNOWN_FINGER) return note;
  return { ...note, hand: note.finger < FINGERS_PER_HAND ? 0 : 1 };
}

/** Compare by onset and pitch; the rest makes the order of simultaneous notes definite. */
function noteOrder(a: Note, b: Note): number {
  return (
    a.onset - b.onset ||
    a.pitch - b.pitch ||
    a.offset - b.offset ||
    a.finger - b.finger ||
    handOrder(a.hand) - handOrder(b.hand) ||
    a.velocity - b.velocity
  );
}

/** Python sorts by the names of the hands: none, "left", "right". */
function handOrder(hand: Note["hand"]): number {
  return hand === null ? 0 : 2 - hand;
}

function mergePedals(pedals: readonly Pedal[]): Pedal[] {
  const merged: Pedal[] = [];
  for (const pedal of [...pedals].sort((a, b) => a.onset - b.onset || a.offset - b.offset)) {
    const last = merged.at(-1);
    if (last && pedal.onset <= last.offset) {
      merged[merged.length - 1] = { onset: last.onset, offset: Math.max(pedal.offset, last.offset) };
    } else {
      merged.push(pedal);
    }
  }
  return merged;
}
