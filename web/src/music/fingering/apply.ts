/** Fingers for a whole score: the one door through which they are chosen. */

import { UNKNOWN_FINGER, type Score } from "../../types";
import { FINGERS_PER_HAND, HANDS } from "../constants";
import { withNotes } from "../score";
import { fingerHand } from "./ergonomic";
import { robotFingers } from "./robot";
import { robotHands } from "./robot_hands";
import { assignHands } from "./split";

/**
 * Return the score with the hands and fingers that suit the simulated hands best.
 *
 * @param controlTimestep length of a control step for which they are chosen, s.
 */
export function applyFingering(score: Score, controlTimestep: number): Score {
  return robotFingers(fingerScore(robotHands(score, controlTimestep)), controlTimestep);
}

/**
 * Return the score with a finger for each note, as a pianist would choose them.
 *
 * Fingers that are known stay, and so do hands; `assignHands` finds the other hands. At most ten fingers are
 * on keys at a time, and none on two. Where more is asked of a hand, it lets go of the key held longest first:
 * that note keeps its length, but its finger goes on. Of more than five keys struck together by one hand, the
 * outer five have a finger; the others have their hand, and no finger (-1).
 */
export function fingerScore(score: Score): Score {
  if (score.notes.every((note) => note.finger !== UNKNOWN_FINGER)) return score;
  const shared = assignHands(score);
  const notes = [...shared.notes];
  for (const [hand] of HANDS) {
    const indices = Array.from(notes.keys()).filter((index) => notes[index]!.hand === hand);
    const fingers = fingerHand(indices.map((index) => notes[index]!), hand);
    indices.forEach((index, place) => {
      const finger = fingers[place]!;
      if (notes[index]!.finger !== UNKNOWN_FINGER || finger === UNKNOWN_FINGER) return;
      notes[index] = { ...notes[index]!, finger: hand * FINGERS_PER_HAND + finger };
    });
  }
  return withNotes(shared, notes);
}
