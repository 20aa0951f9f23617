"""Dividing line between the two arms, state by state, m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.music.constants import MIDDLE
from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.reading.key_frames import KeyFrames

# A hand counts as busy so many states before and after it plays.
_BUSY_STATES = 6

_IDLE_APART = 0.05  # additional distance of an arm that plays nothing, m


def wanted_places(frames: KeyFrames, sign: int, rest: float) -> tuple[FloatArray, BoolArray]:
    """Return where across the keys a hand would be if it were alone; it rests at ``rest``, m.

    Returns:
        (s,) places of the middle finger, m; (s,) whether the hand is busy.
    """
    weight = frames.weight[..., 1]  # (s, 5)
    asked: BoolArray = np.asarray(weight.any(axis=1))
    if not asked.any():
        return np.full(len(asked), rest), asked
    fingers = np.arange(frames.target.shape[1]) - MIDDLE
    place = frames.target[..., 1] - sign * KEY_SPACING * fingers
    known = np.flatnonzero(asked)
    mean = (weight * place).sum(axis=1)[known] / weight.sum(axis=1)[known]
    window = np.ones(2 * _BUSY_STATES + 1)
    busy = np.convolve(asked, window)[_BUSY_STATES:-_BUSY_STATES] > 0
    return np.interp(np.arange(len(asked)), known, mean), busy


def dividing_line(
    places: Sequence[FloatArray], busy: Sequence[BoolArray], apart: float
) -> FloatArray:
    """Return a first line between the arms, (s,) m.

    Where both are busy it lies in the middle; a hand that plays makes one that rests give way.

    Args:
        places: Where the right and the left hand want to be, (s,) m each.
        busy: Whether they play, (s,) bool each.
        apart: Least distance of the arms, m.
    """
    right, left = places
    extra = np.where(busy[0] & busy[1], 0.0, _IDLE_APART)
    short = np.maximum(left + apart + extra - right, 0)
    share = np.where(busy[0] == busy[1], 0.5, np.where(busy[0], 0.0, 1.0))
    return np.asarray(((right + share * short) + (left - (1 - share) * short)) / 2)


def bounds_of(line: FloatArray, apart: float) -> tuple[FloatArray, FloatArray]:
    """Return beyond which places the right and the left arm must be, (s,) m each."""
    return line + apart / 2, line - apart / 2
