"""Dynamics: how loud a note is, as the speed of its key and as MIDI's velocity.

Loudness is heard in ratios, so that the map is logarithmic: velocity = 62 + 25 log2(speed), with
the speed in rad/s. Of 1,948 strikes in four pieces on two physics profiles, the sight-reader's have
0.47 to 2.68 rad/s, velocities of 35 to 98, and the planner's 0.56 to 3.34, velocities of 41 to 106
(5 to 95 %). The page in the browser has the same map (``web/src/music/dynamics.ts``).
"""

from __future__ import annotations

import math

AT_ONE = 62
"""MIDI velocity of a key that is struck with 1 rad/s."""

PER_DOUBLING = 25
"""Difference of velocity between a speed and twice that."""

SOFTEST, LOUDEST = 1, 127


def velocity_of(speed: float) -> int:
    """Return the MIDI velocity of a strike, 1 to 127.

    Args:
        speed: Angular speed of the key as it begins to sound, rad/s.
    """
    if speed <= 0:
        return SOFTEST
    return min(max(round(AT_ONE + PER_DOUBLING * math.log2(speed)), SOFTEST), LOUDEST)
