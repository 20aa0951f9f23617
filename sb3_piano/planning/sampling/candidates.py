"""Random changes of what the actuators are told, over a horizon of control steps."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.planning.sampling.settings import SamplingNoise
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class Candidates:
    """Draws changes as splines: values at a few knots, straight lines between them."""

    def __init__(self, noise: SamplingNoise, scene: PianoScene, horizon: int):
        """Choose the standard deviation of each actuator.

        Args:
            noise: How much and where.
            scene: Whose actuators are told.
            horizon: Control steps, at least 1.
        """
        self._noise = noise
        self.deviation = deviations(noise, scene)
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


def deviations(noise: SamplingNoise, scene: PianoScene) -> FloatArray:
    """Return the standard deviation of each actuator's noise at a knot, (nu,) rad or m."""
    result = np.full(scene.model.nu, noise.finger)
    for actuator in range(scene.model.nu):
        name = scene.model.actuator(actuator).name
        if "forearm" in name:
            result[actuator] = noise.forearm
        elif "WRJ" in name:
            result[actuator] = noise.wrist
    return result


def _spline(at: FloatArray | npt.NDArray[np.intp], times: FloatArray) -> FloatArray:
    """Return the weights of the knots at some times, (n, k); the last knot holds on."""
    unit = np.eye(len(times))
    return np.stack([np.interp(at, times, row) for row in unit], axis=1)
