"""Dynamics: how loud a note is, as the speed of its key and as MIDI's velocity.

Loudness is heard in ratios, so that the map is logarithmic: velocity = 62 + 25 log2(speed), with
the speed in rad/s. The simulated hands strike keys with 0.3 to 5 rad/s, which are velocities of 19
to 120; half of their strikes lie between 52 and 86. The page in the browser has the same map
(``web/src/music/dynamics.ts``).
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


def speed_of(velocity: float) -> float:
    """Return the speed of a key, rad/s, whose strike has a MIDI velocity."""
    return float(2 ** ((velocity - AT_ONE) / PER_DOUBLING))
