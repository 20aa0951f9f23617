/** Pieces: scores that are ready to be played. */

import { CONTROL_TIMESTEP, NUM_KEYS, UNKNOWN_FINGER, type Piece, type PianoRoll, type Score } from "../types";
import { applyFingering, fingerScore } from "./fingering/apply";
import { releaseEarly } from "./fingering/robot";
import { summary, unheld } from "./problems";
import { rollOf } from "./roll";
import { hasFingering, trimSilence } from "./score";

/**
 * Return a score ready to be played: from its first note on, with a finger for each note that can have one.
 *
 * A score without fingers gets those that suit the simulated hands; one that has some gets the missing ones.
 *
 * @param id what permalinks and menus call it.
 * @param score the piece; what was left out as it was read is told again.
 * @throws InputError if it is too long.
 */
export function pieceOf(id: string, score: Score & { readonly warnings?: readonly string[] }): Piece {
  let played = score as Score;
  let roll = rollOf(trimSilence(played), CONTROL_TIMESTEP);
  if (lacksFingers(roll)) {
    played = hasFingering(played) ? fingerScore(played) : applyFingering(played, CONTROL_TIMESTEP);
    roll = rollOf(trimSilence(played), CONTROL_TIMESTEP);
  }
  const problems = unheld(releaseEarly(roll));
  const told = problems.length > 0 ? [summary(problems, CONTROL_TIMESTEP)] : [];
  return { id, score: trimSilence(played), roll, warnings: [...(score.warnings ?? []), ...told] };
}

/** Return whether a note is due that has no finger. */
function lacksFingers({ steps, active, finger }: PianoRoll): boolean {
  for (let at = 0; at < steps * NUM_KEYS; at++) {
    if (active[at] && finger[at] === UNKNOWN_FINGER) return true;
  }
  return false;
}
