"""Random variations of the hands' motion over the next control steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.planning.roll_outs import Way
from sb3_piano.planning.sampling.noise import Candidates, SamplingNoise
from sb3_piano.simulation import PianoScene

_NOISE = SamplingNoise(knots=3)
_SIZES = (0.4, 1.0, 2.0)
"""Factors of a variation's noise, one of which is drawn."""
_SHIFTED = 0.25
"""Share of variations with a shift of a hand's motion in time."""
_SHIFT = 1.0
"""Standard deviation of the shift, control steps."""
_SHIFT_STEPS = 2
"""Control steps over which the shift builds up."""


class Variation(NamedTuple):
    """Variation of the followed motion of one or two hands."""

    knots: FloatArray
    """(k, n) changes of the commands, as knots of :class:`Candidates`."""
    shift: FloatArray
    """(h,) control steps by which each hand is ahead of time."""


class Variations:
    """Draws variations, and applies them to motions."""

    def __init__(self, scene: PianoScene, horizon: int) -> None:
        """Set the noise of each actuator over some control steps."""
        self._candidates = Candidates(_NOISE, scene, horizon)
        self._n_hands = len(scene.sides)
        self._size = len(self.deviation) // self._n_hands

    @property
    def deviation(self) -> FloatArray:
        """(n,) standard deviation of each actuator's noise, rad or m."""
        return self._candidates.deviation

    def none(self) -> Variation:
        """Return the variation that changes nothing."""
        return Variation(self._candidates.none(), np.zeros(self._n_hands))

    def drawn(self, centre: Variation, count: int, random: np.random.Generator) -> list[Variation]:
        """Draw random variations around one."""
        noise = self._candidates.draw(count, random)
        sizes = random.choice(_SIZES, size=count)
        shifts = _SHIFT * random.standard_normal((count, self._n_hands))
        shifts *= random.random((count, self._n_hands)) < _SHIFTED
        return [
            Variation(centre.knots + size * knots, centre.shift + shift)
            for knots, size, shift in zip(noise, sizes, shifts, strict=True)
        ]

    def joined(self, one: Variation, hand: int, other: Variation) -> Variation:
        """Replace the part of a hand in one variation by that in another."""
        knots, shift = one.knots.copy(), one.shift.copy()
        knots[:, self._of(hand)] = other.knots[:, self._of(hand)]
        shift[hand] = other.shift[hand]
        return Variation(knots, shift)

    def way(self, followed: Way, step: int, steps: int, variation: Variation) -> Way:
        """Apply a variation to the followed motion in some control steps from ``step`` on."""
        changes = self._candidates.over_horizon(variation.knots[None])[0][:steps]
        commands, positions = (array[step : step + steps].copy() for array in followed)
        # Positions are those before a control step: the first one is not shifted yet.
        ramp = np.minimum(np.arange(steps + 1) / _SHIFT_STEPS, 1.0)
        for hand in np.flatnonzero(variation.shift).tolist():
            own, ahead = self._of(hand), step + np.arange(steps)
            shift = variation.shift[hand]
            commands[:, own] = _at(followed.commands[:, own], ahead + shift * ramp[1:])
            positions[:, own] = _at(followed.positions[:, own], ahead + shift * ramp[:-1])
        return Way(commands + changes, positions)

    def _of(self, hand: int) -> slice:
        return slice(hand * self._size, (hand + 1) * self._size)


def _at(rows: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate rows of an array, (T, n), at times that may lie between them or beyond."""
    times = np.clip(times, 0, len(rows) - 1)
    lower = np.minimum(times.astype(int), max(len(rows) - 2, 0))
    upper = np.minimum(lower + 1, len(rows) - 1)
    share = (times - lower)[:, None]
    return np.asarray((1 - share) * rows[lower] + share * rows[upper])
