"""Cost of changes of velocity over the states of a stretch, as a banded quadratic form."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.planning.kinematics import HandKinematics
from sb3_piano.planning.settings import PlanSettings

FloatArray = npt.NDArray[np.float64]


class Smoothness:
    """The sum of squared first and second differences, weighted by actuator.

    Args:
        kinematics: The hand.
        settings: The plan's constants.
        before: (2, n) actuator positions in the two states before the stretch.
        n_states: How many states the stretch has.
    """

    def __init__(
        self,
        kinematics: HandKinematics,
        settings: PlanSettings,
        before: FloatArray,
        n_states: int,
    ):
        self._second = _by_joint(kinematics, settings) ** 2
        self._first = np.full(kinematics.size, settings.velocity**2)
        self._before = before
        self.band = self._band(n_states, kinematics.size)
        """(2 n + 1, s n) the Hessian of half the cost: its lower diagonals, as LAPACK has them."""

    def cost(self, positions: FloatArray) -> float:
        """Return the cost of (s, n) actuator positions."""
        speed, change = self._differences(positions)
        return float((self._first * speed**2).sum() + (self._second * change**2).sum())

    def gradient(self, positions: FloatArray) -> FloatArray:
        """Return the gradient of half the cost, (s, n)."""
        speed, change = self._differences(positions)
        result = self._first * speed + self._second * change
        result[:-1] -= self._first * speed[1:] + 2 * self._second * change[1:]
        result[:-2] += self._second * change[2:]
        return np.asarray(result)

    def _differences(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        whole = np.concatenate([self._before, positions])
        speed = np.diff(whole, axis=0)
        return speed[1:], np.diff(speed, axis=0)

    def _band(self, count: int, size: int) -> FloatArray:
        here, one_on, two_on = (np.zeros((count, size)) for _ in range(3))
        here += self._first + self._second
        here[:-1] += self._first + 4 * self._second
        here[:-2] += self._second
        one_on[:-1] -= self._first + 2 * self._second
        one_on[:-2] -= 2 * self._second
        two_on[:-2] += self._second
        band = np.zeros((2 * size + 1, count * size))
        band[0], band[size], band[2 * size] = here.ravel(), one_on.ravel(), two_on.ravel()
        return band


def _by_joint(kinematics: HandKinematics, settings: PlanSettings) -> FloatArray:
    special = {
        "WRJ1": settings.jerk_wrist,
        "WRJ2": settings.jerk_wrist,
        "forearm_tx": settings.jerk_along,
        "forearm_ty": settings.jerk_inwards,
    }
    return np.array([special.get(name, settings.jerk_finger) for name in kinematics.names])
