"""Map the speed of a key to MIDI velocity, the loudness of a note.

Hearing is logarithmic, and so is the map: velocity = 62 + 25 log2(speed), with the speed in rad/s.
In 1,948 strikes of four pieces on two physics profiles, the sight-reader's have 0.47 to 2.68 rad/s,
velocities of 35 to 98, and the planner's 0.56 to 3.34, velocities of 41 to 106 (5 to 95 %). The
browser page uses the same map (``web/src/music/dynamics.ts``).
"""

from __future__ import annotations

import math

AT_ONE = 62
"""MIDI velocity of a key struck at 1 rad/s."""

PER_DOUBLING = 25
"""Difference of velocity for twice the speed."""

SOFTEST, LOUDEST = 1, 127


def velocity_of(speed: float) -> int:
    """Convert a key's speed to the MIDI velocity of its strike, 1 to 127.

    Args:
        speed: Angular speed of the key as it begins to sound, rad/s.
    """
    if speed <= 0:
        return SOFTEST
    return min(max(round(AT_ONE + PER_DOUBLING * math.log2(speed)), SOFTEST), LOUDEST)


def speed_of(velocity: float) -> float:
    """Convert a MIDI velocity to the key's speed, rad/s: the inverse of :func:`velocity_of`."""
    return float(2.0 ** ((velocity - AT_ONE) / PER_DOUBLING))
