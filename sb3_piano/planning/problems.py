"""Notes of a piece that the hands cannot play as written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.music import MIN_PITCH, PianoRoll
from sb3_piano.music.constants import FINGER_NAMES, UNKNOWN_FINGER
from sb3_piano.music.hands import FINGERS_PER_HAND
from sb3_piano.music.pitch import pitch_name
from sb3_piano.planning.grips import EarlyRelease
from sb3_piano.planning.key_frames import KeyFrames
from sb3_piano.planning.leaps import TimedPress

FloatArray = npt.NDArray[np.float64]

# From how far off on a note counts as out of reach: a white key is 23.5 mm wide, a fingertip 13 mm.
_TOLERANCE = 0.006


@dataclass(frozen=True)
class Problem:
    """A note that cannot be played as it is written."""

    pitch: int
    """MIDI pitch."""
    time: float
    """Its onset, s from the start of the episode."""
    finger: int
    """The finger that has it, 0 to 9, of a note that is let go as it is written; -1 for none."""
    reason: str
    """The problem in words."""
    error: float = 0.0
    """Distance of the fingertip from its place on the key, m."""

    def __str__(self) -> str:
        who = "" if self.finger == UNKNOWN_FINGER else f", {FINGER_NAMES[self.finger]}"
        note = f"{pitch_name(self.pitch)} (pitch {self.pitch}) at {self.time:.2f} s"
        return f"{note}{who}: {self.reason}"


def unreached(
    timed: Sequence[TimedPress],
    hand: int,
    frames: KeyFrames,
    fingertips: FloatArray,
    control_timestep: float,
) -> list[Problem]:
    """Return the notes whose keys the planned fingertips do not reach.

    Args:
        timed: The hand's presses.
        hand: 0 for the right hand, 1 for the left one.
        frames: What was asked, of s states.
        fingertips: (s, 5, 3) where the fingertips are planned to be, m.
        control_timestep: Length of a control step, s.
    """
    problems = []
    for one in timed:
        press = one.press
        states = slice(one.first, one.last + 1)
        off = fingertips[states, press.finger, 1:] - frames.target[states, press.finger, 1:]
        error = float(np.abs(off).max(initial=0.0))
        if error > _TOLERANCE:
            problems.append(
                Problem(
                    pitch=MIN_PITCH + press.key,
                    time=(press.first - 1) * control_timestep,
                    finger=hand * FINGERS_PER_HAND + press.finger,
                    reason=f"out of reach by {1000 * error:.0f} mm",
                    error=error,
                )
            )
    return problems


def not_held(gone: Sequence[EarlyRelease], hand: int, control_timestep: float) -> list[Problem]:
    """Return the notes that are let go before their end, or not struck."""
    problems = []
    for one in gone:
        press, instead = one.press, pitch_name(MIN_PITCH + one.for_key)
        early = (press.last - one.last) * control_timestep
        reason = f"let go early by {early:.2f} s for {instead}"
        if one.last < press.first:
            reason = f"left out by the hand, which plays {instead}"
        problems.append(
            Problem(
                pitch=MIN_PITCH + press.key,
                time=(press.first - 1) * control_timestep,
                finger=hand * FINGERS_PER_HAND + press.finger,
                reason=reason,
            )
        )
    return problems


def fingerless(roll: PianoRoll) -> list[Problem]:
    """Return the notes that have no finger: more sound at once than a hand can hold."""
    return [
        Problem(
            pitch=MIN_PITCH + int(key),
            time=int(step) * roll.control_timestep,
            finger=UNKNOWN_FINGER,
            reason="no finger is left for it",
        )
        for step, key in np.argwhere(roll.onset & (roll.finger == UNKNOWN_FINGER))
    ]


def unmovable(
    timed: Sequence[TimedPress], hand: int, moving: slice, control_timestep: float
) -> list[Problem]:
    """Return the notes whose keys are rigid in the scene."""
    return [
        Problem(
            pitch=MIN_PITCH + one.press.key,
            time=(one.press.first - 1) * control_timestep,
            finger=hand * FINGERS_PER_HAND + one.press.finger,
            reason="its key is rigid in this scene",
        )
        for one in timed
        if not moving.start <= one.press.key < moving.stop
    ]


def summary(problems: Sequence[Problem], shown: int = 5) -> str:
    """Return the problems in words, the first ones by name."""
    kinds = Counter(problem.reason.split(" by ")[0] for problem in problems)
    listed = "; ".join(str(problem) for problem in problems[:shown])
    more = f"; and {len(problems) - shown} more" if len(problems) > shown else ""
    counted = ", ".join(f"{count} x {kind}" for kind, count in kinds.items())
    notes = "1 note" if len(problems) == 1 else f"{len(problems)} notes"
    return f"{notes} cannot be played as written ({counted}): {listed}{more}."
