"""Dividing line between the two arms, state by state, m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sb3_piano.planning.key_frames import KeyFrames
from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.leaps import MIDDLE_FINGER
from sb3_piano.planning.posture import Posture
from sb3_piano.planning.settings import PlanSettings

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# A hand counts as busy so many states before and after it plays.
_BUSY_STATES = 6


def wanted_places(
    frames: KeyFrames, sign: int, posture: Posture, keys: KeyPlaces
) -> tuple[FloatArray, BoolArray]:
    """Return where across the keys a hand would be if it were alone.

    Args:
        frames: What is asked of its fingertips, of s states.
        sign: 1 for the right hand, -1 for the left one.
        posture: The hand at rest, where it remains if it plays nothing.
        keys: The keyboard.

    Returns:
        (s,) places of the middle finger, m; (s,) whether the hand is busy.
    """
    weight = frames.weight[..., 1]  # (s, 5)
    asked: BoolArray = np.asarray(weight.any(axis=1))
    if not asked.any():
        return np.full(len(asked), posture.middle), asked
    fingers = np.arange(frames.target.shape[1]) - MIDDLE_FINGER
    place = frames.target[..., 1] - sign * keys.spacing * fingers
    known = np.flatnonzero(asked)
    mean = (weight * place).sum(axis=1)[known] / weight.sum(axis=1)[known]
    window = np.ones(2 * _BUSY_STATES + 1)
    busy = np.convolve(asked, window)[_BUSY_STATES:-_BUSY_STATES] > 0
    return np.interp(np.arange(len(asked)), known, mean), busy


def dividing_line(
    places: Sequence[FloatArray], busy: Sequence[BoolArray], settings: PlanSettings
) -> FloatArray:
    """Return a first line between the arms, (s,) m.

    Where both are busy it lies in the middle; a hand that plays makes one that rests give way.

    Args:
        places: Where the right and the left hand want to be, (s,) m each.
        busy: Whether they play, (s,) bool each.
        settings: The plan's constants.
    """
    right, left = places
    extra = np.where(busy[0] & busy[1], 0.0, settings.idle_arm_apart)
    short = np.maximum(left + settings.arms_apart + extra - right, 0)
    share = np.where(busy[0] == busy[1], 0.5, np.where(busy[0], 0.0, 1.0))
    return np.asarray(((right + share * short) + (left - (1 - share) * short)) / 2)


def bounds_of(line: FloatArray, settings: PlanSettings) -> tuple[FloatArray, FloatArray]:
    """Return beyond which places the right and the left arm must be, (s,) m each."""
    return line + settings.arms_apart / 2, line - settings.arms_apart / 2
