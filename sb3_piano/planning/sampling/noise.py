"""Random changes of the actuators' controls over a horizon of control steps."""

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
    """Settings of the candidates' random differences from the last control step's best one.

    The defaults are for sampling around a plan.

    Raises:
        ConfigError: If a value is out of range.
    """

    share: Annotated[Number, Gt(0), Le(1)] = 0.4
    """Share of the actuators that a candidate changes; above 0, at most 1."""
    knots: Count = 2
    """Points of the horizon at which noise is drawn, including the first and the last step; it is
    linear between them. 1 (constant noise) or more."""
    finger: NotNegative = 0.12
    """Standard deviation of the fingers' actuators at a knot, rad."""
    wrist: NotNegative = 0.04
    """Standard deviation of the wrists' actuators, rad."""
    forearm: NotNegative = 0.008
    """Standard deviation of the forearms' sliders, m; 0.4 m correspond to 1 rad of their turns."""
    decay: Share = 0.9
    """Share of the last control step's best change to keep for the next one, in [0, 1]."""


NOISE_FROM_ZERO = SamplingNoise(knots=3, finger=0.3, wrist=0.15, forearm=0.04, decay=1.0)
"""Noise for sampling without a plan."""


class Candidates:
    """Random changes as linear splines, with values at a few knots."""

    def __init__(self, noise: SamplingNoise, scene: PianoScene, horizon: int):
        """Set the standard deviation of each actuator, over one control step or more."""
        self._noise = noise
        of_kind = {"finger": noise.finger, "wrist": noise.wrist, "forearm": noise.forearm}
        of_kind["elbow"] = noise.forearm / FOREARM_TRAVEL  # as far for a fingertip as the slider
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
        """Compute the knots of a change shifted by one control step, (k, nu)."""
        return np.asarray(self._noise.decay * (self._later @ knots))

    def draw(self, count: int, random: np.random.Generator) -> FloatArray:
        """Draw the knots of random changes, (count, k, nu)."""
        shape = (count, len(self._times), len(self.deviation))
        drawn = random.standard_normal(shape) * self.deviation
        chosen = random.random((count, 1, len(self.deviation))) < self._noise.share
        return np.asarray(drawn * chosen)

    def over_horizon(self, knots: FloatArray) -> FloatArray:
        """Interpolate changes with knots (n, k, nu) at each control step: (n, horizon, nu)."""
        return np.asarray(self._weights @ knots)


def _spline(at: FloatArray | IntArray, times: FloatArray) -> FloatArray:
    """Compute the weights of the knots at some times, (n, k), constant after the last knot."""
    unit = np.eye(len(times))
    return np.stack([np.interp(at, times, row) for row in unit], axis=1)
