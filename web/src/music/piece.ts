/** Pieces: scores that are ready to be played. */

import { CONTROL_TIMESTEP, type Piece, type Score } from "../types";
import { applyFingering } from "./fingering/apply";
import { releaseEarly } from "./fingering/robot";
import { summary, unheld } from "./problems";
import { rollOf } from "./roll";
import { trimSilence } from "./score";

/** Silence before the first note, s, in which the hands take their places. */
const INITIAL_BUFFER_TIME = 0.5;

/**
 * Return a score ready to be played, as Python's players get it (`PLANNED_IN` and `trim_silence`).
 *
 * It begins with its first note after half a second. Hands and fingers that do not suit the simulated hands, or are
 * missing, are changed, and keys that a finger has to leave early are let go of early.
 *
 * @param id what permalinks and menus call it.
 * @param score the piece; what was left out as it was read is told again.
 * @throws InputError if it is too long.
 */
export function pieceOf(id: string, score: Score & { readonly warnings?: readonly string[] }): Piece {
  const played = trimSilence(applyFingering(score, CONTROL_TIMESTEP));
  const roll = releaseEarly(rollOf(played, CONTROL_TIMESTEP, INITIAL_BUFFER_TIME));
  const problems = unheld(roll);
  const told = problems.length > 0 ? [summary(problems, CONTROL_TIMESTEP)] : [];
  return { id, score: played, roll, warnings: [...(score.warnings ?? []), ...told], lead: INITIAL_BUFFER_TIME };
}
