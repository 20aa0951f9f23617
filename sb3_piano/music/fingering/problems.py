"""Notes that the hands cannot play as written, found from the piano roll alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.music.constants import FINGER_NAMES, MIN_PITCH, UNKNOWN_FINGER
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.roll import PianoRoll


@dataclass(frozen=True)
class Problem:
    """Note that cannot be played as written."""

    pitch: int
    """MIDI pitch."""
    time: float
    """Its onset, s from the start of the episode."""
    finger: int
    """Its written finger, 0 to 9, also if released early; -1 for none."""
    reason: str
    """The problem in words."""
    error: float = 0.0
    """Distance of the fingertip from its place on the key, m."""

    def __str__(self) -> str:
        who = "" if self.finger == UNKNOWN_FINGER else f", {FINGER_NAMES[self.finger]}"
        note = f"{pitch_name(self.pitch)} (pitch {self.pitch}) at {self.time:.2f} s"
        return f"{note}{who}: {self.reason}"


def unheld(roll: PianoRoll) -> list[Problem]:
    """Find the notes that no finger holds as written, in order of time.

    They have no finger, are released early, or are left out. Other problems need a plan. The roll
    must come from :func:`~sb3_piano.music.fingering.robot.release_early`.
    """
    timestep = roll.control_timestep
    left_out = {(one.release, one.key) for one in roll.early_releases}
    # More notes sound at once than a hand can hold.
    problems = [
        problem_of(timestep, key, step, UNKNOWN_FINGER, "no finger is left for it")
        for step, key in np.argwhere(roll.onset & (roll.finger == UNKNOWN_FINGER)).tolist()
        if (step, key) not in left_out
    ]
    for one in roll.early_releases:
        if one.onset < one.release == one.offset - 1:  # rounding to control steps, inaudible
            continue
        instead = pitch_name(MIN_PITCH + one.for_key)
        reason = f"let go early by {(one.offset - one.release) * timestep:.2f} s for {instead}"
        if one.release <= one.onset:
            reason = f"left out by the hand, which plays {instead}"
        problems.append(problem_of(timestep, one.key, one.onset, one.finger, reason))
    return sorted(problems, key=lambda problem: problem.time)


def problem_of(
    timestep: float, key: int, step: int, finger: int, reason: str, error: float = 0.0
) -> Problem:
    """Make the problem of a note from its key and first control step."""
    return Problem(MIN_PITCH + key, step * timestep, finger, reason, error)


def summary(problems: Sequence[Problem], shown: int = 5) -> str:
    """Describe problems in words, the first ones by name."""
    kinds = Counter(problem.reason.split(" by ")[0] for problem in problems)
    listed = "; ".join(str(problem) for problem in problems[:shown])
    more = f"; and {len(problems) - shown} more" if len(problems) > shown else ""
    counted = ", ".join(f"{count} x {kind}" for kind, count in kinds.items())
    notes = "1 note" if len(problems) == 1 else f"{len(problems)} notes"
    return f"{notes} cannot be played as written ({counted}): {listed}{more}."
