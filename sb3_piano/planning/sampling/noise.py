"""Random changes of what the actuators are told, over a horizon of control steps."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Gt, Le

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.settings import Count, NotNegative, Number, Share, settings
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import FOREARM_TRAVEL


@settings
class SamplingNoise:
    """Random differences of candidates from the best of the last control step.

    The defaults are for sampling around a plan.

    Raises:
        ConfigError: If a value is out of range.
    """

    share: Annotated[Number, Gt(0), Le(1)] = 0.4
    """Of the actuators, which a candidate changes; above 0, at most 1."""
    knots: Count = 2
    """Points of the horizon at which noise is drawn, the first and the last step included; it is
    linear between them. 1 (constant noise) or more."""
    finger: NotNegative = 0.12
    """Standard deviation at a knot, rad, of the fingers' actuators."""
    wrist: NotNegative = 0.04
    """That of the wrists' actuators, rad."""
    forearm: NotNegative = 0.008
    """That of the sliders on which the forearms stand, m; for each rad of their turns 0.4 m."""
    decay: Share = 0.9
    """Share of the last control step's best change that is kept for the next one, in [0, 1]."""


NOISE_FROM_ZERO = SamplingNoise(knots=3, finger=0.3, wrist=0.15, forearm=0.04, decay=1.0)
"""Noise for sampling without a plan."""


class Candidates:
    """Draws changes as splines: values at a few knots, straight lines between them."""

    def __init__(self, noise: SamplingNoise, scene: PianoScene, horizon: int):
        """Choose the standard deviation of each actuator, over one control step or more."""
        self._noise = noise
        of_kind = {"finger": noise.finger, "wrist": noise.wrist, "forearm": noise.forearm}
        of_kind["elbow"] = noise.forearm / FOREARM_TRAVEL  # as far as the slider takes a fingertip
        self.deviation = np.array([of_kind[str(kind)] for kind in scene.actuator_kind])
        """(nu,) standard deviation of each actuator's noise at a knot, rad or m."""
        n_knots = min(noise.knots, horizon)
        self._times = np.linspace(0, horizon - 1, n_knots) if n_knots > 1 else np.zeros(1)
        self._weights = _spline(np.arange(horizon), self._times)  # (horizon, n_knots)
        self._later = _spline(self._times + 1, self._times)  # (n_knots, n_knots)

    def none(self) -> FloatArray:
        """Return the knots of no change, (k, nu)."""
        return np.zeros((len(self._times), len(self.deviation)))

    def shifted(self, knots: FloatArray) -> FloatArray:
        """Return the knots of a change as it continues a control step later, (k, nu)."""
        return np.asarray(self._noise.decay * (self._later @ knots))

    def draw(self, count: int, random: np.random.Generator) -> FloatArray:
        """Return the knots of random changes, (count, k, nu)."""
        shape = (count, len(self._times), len(self.deviation))
        drawn = random.standard_normal(shape) * self.deviation
        chosen = random.random((count, 1, len(self.deviation))) < self._noise.share
        return np.asarray(drawn * chosen)

    def over_horizon(self, knots: FloatArray) -> FloatArray:
        """Return changes, given as knots (n, k, nu), at each control step: (n, horizon, nu)."""
        return np.asarray(self._weights @ knots)


def _spline(at: FloatArray | IntArray, times: FloatArray) -> FloatArray:
    """Return the weights of the knots at some times, (n, k); the last knot holds on."""
    unit = np.eye(len(times))
    return np.stack([np.interp(at, times, row) for row in unit], axis=1)
