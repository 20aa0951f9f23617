"""Map the speed of a key to MIDI velocity, the loudness of a note.

Hearing is logarithmic, and so is the map: velocity = 25 log2(n) - 50, where n is how often the key
would make its travel in a second. White keys have the velocity 48 at 1 rad/s; black ones 37, as
their levers are shorter and turn farther. Hands can play what music asks for in this range.
The browser page uses the same map (``web/src/music/dynamics.ts``).
"""

from __future__ import annotations

import math

import numpy as np

from sb3_piano.music.constants import KEY_IS_BLACK

TRAVEL = np.where(KEY_IS_BLACK, 0.08865588186743747, 0.06656816377582381)
"""(88,) angle of each key fully down, rad."""

PER_DOUBLING = 25.0
"""Difference of velocity for twice the speed."""

AT_ONE = -50.0 - PER_DOUBLING * np.log2(TRAVEL)
"""(88,) MIDI velocity of each key struck at 1 rad/s."""

SOFTEST, LOUDEST = 1, 127


def velocity_of(speed: float, key: int) -> int:
    """Convert a key's speed to the MIDI velocity of its strike, 1 to 127.

    Args:
        speed: Angular speed of the key as it begins to sound, rad/s.
        key: The key, 0 to 87.
    """
    if speed <= 0:
        return SOFTEST
    velocity = round(float(AT_ONE[key]) + PER_DOUBLING * math.log2(speed))
    return min(max(velocity, SOFTEST), LOUDEST)


def speed_of(velocity: float, key: int) -> float:
    """Convert a MIDI velocity to the key's speed, rad/s: the inverse of :func:`velocity_of`."""
    return float(2.0 ** ((velocity - float(AT_ONE[key])) / PER_DOUBLING))
