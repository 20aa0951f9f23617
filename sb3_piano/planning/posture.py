"""The hand at rest over five neighbouring white keys."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares

from sb3_piano.music.hands import FINGERS_PER_HAND
from sb3_piano.planning.key_places import THUMB, KeyPlaces
from sb3_piano.planning.kinematics import HandKinematics
from sb3_piano.planning.leaps import MIDDLE_FINGER
from sb3_piano.planning.settings import PlanSettings

FloatArray = npt.NDArray[np.float64]

# Curled fingers, a thumb held out: where the search for the posture begins, rad.
_CURLED = {"J3": 1.0, "J0": 1.0, "WRJ1": -0.08, "THJ4": 0.8}
_HEIGHT = 0.0187  # of the fingertips' centres over the keys' tops, m
_TRIALS = 2

# How firmly posture is held, in multiples of a finger's: the arm goes where it must.
_FIRMNESS = {"WRJ1": 2.0, "WRJ2": 2.0, "forearm_tx": 0.01, "forearm_ty": 2.0}
_FIRMNESS_ABDUCTION = 1.5


@dataclass(frozen=True, eq=False)
class Posture:
    """A hand's resting posture."""

    names: tuple[str, ...]
    """Short names of the hand's actuators."""
    rest: FloatArray
    """(n,) actuator positions, rad; 0 m for the slider along the keyboard."""
    middle: float
    """Place of the middle finger across the keys, m."""

    def pull(self, settings: PlanSettings) -> FloatArray:
        """Return what a distance from it counts by actuator, (n,) per rad or m."""
        firmness = [
            _FIRMNESS.get(
                name, _FIRMNESS_ABDUCTION if name.endswith("J4") and name != "THJ4" else 1.0
            )
            for name in self.names
        ]
        return settings.posture * np.array(firmness)


def resting_posture(kinematics: HandKinematics, keys: KeyPlaces, settings: PlanSettings) -> Posture:
    """Return the posture in which the fingertips lie over neighbouring white keys."""
    middle = float(kinematics.arm(np.zeros((1, kinematics.size)))[0])
    across = middle + kinematics.sign * keys.spacing * (np.arange(FINGERS_PER_HAND) - MIDDLE_FINGER)
    along = np.full(FINGERS_PER_HAND, settings.white_x)
    along[THUMB] = settings.white_x_thumb
    height = float(np.min(keys.top)) + _HEIGHT
    target = np.stack([along, across, np.full(FINGERS_PER_HAND, height)], axis=1)
    start = np.array([_start(name) for name in kinematics.names])
    return Posture(kinematics.names, _solve(kinematics, target, start), middle)


def _start(name: str) -> float:
    return next((value for end, value in _CURLED.items() if _matches(name, end)), 0.0)


def _matches(name: str, end: str) -> bool:
    return name.endswith(end) and not (end == "J3" and name == "THJ3")


def _solve(kinematics: HandKinematics, target: FloatArray, start: FloatArray) -> FloatArray:
    low, high = kinematics.low, kinematics.high
    rng = np.random.default_rng(0)

    def residuals(positions: FloatArray) -> FloatArray:
        off = kinematics.fingertips(positions[None])[0] - target
        return np.concatenate([10 * off.ravel(), 0.01 * (positions - start)])

    def slopes(positions: FloatArray) -> FloatArray:
        _, jacobian = kinematics.fingertips_and_jacobian(positions[None])
        return np.concatenate(
            [10 * jacobian[0].reshape(target.size, -1), 0.01 * np.eye(len(start))]
        )

    solutions = []
    for trial in range(_TRIALS):
        noise = 0.2 * rng.standard_normal(len(start)) if trial else 0.0
        guess = np.clip(start + noise, low + 1e-6, high - 1e-6)
        solutions.append(least_squares(residuals, guess, jac=slopes, bounds=(low, high)))
    best = min(solutions, key=lambda solution: float(solution.cost))
    return np.asarray(best.x)
