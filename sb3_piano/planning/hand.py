"""A hand as the planner knows it: fingertips, resting posture, and motion as a linear system."""

from __future__ import annotations

import functools
import pickle
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sb3_piano.arrays import FloatArray
from sb3_piano.music.constants import FINGERS_PER_HAND, MIDDLE, THUMB
from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.planning.tracking_control import HandDynamics
from sb3_piano.reading.keyboard import WHITE_X, KeyPlaces
from sb3_piano.reading.kinematics import HandKinematics
from sb3_piano.simulation import PianoScene

# Curled fingers, a thumb held out: where the search for the posture begins, rad.
_CURLED = {"J3": 1.0, "J0": 1.0, "WRJ1": -0.08, "THJ4": 0.8}
# Turns of the forearm that are not sought: elbows are out, and hands have room beside each other.
_HELD = {"forearm_yaw": -0.1, "forearm_roll": 0.0, "forearm_pitch": 0.0, "forearm_tz": 0.0}
_HEIGHT = 0.0187  # of the fingertips' centres over the keys' tops, m
_TRIALS = 2

_PULL = 0.01  # weight of a finger's distance from the resting posture, per rad
# How firmly the others are held, in multiples of that: the arm goes where it must.
_FIRMNESS = {"WRJ1": 2.0, "WRJ2": 2.0, "forearm_tx": 0.01, "forearm_ty": 2.0}
_FIRMNESS_ABDUCTION = 1.5


@dataclass(frozen=True, eq=False)
class Hand:
    """One hand, at rest over five neighbouring white keys."""

    kinematics: HandKinematics
    """Its fingertips."""
    keys: KeyPlaces
    """The keyboard under it."""
    rest: FloatArray
    """(n,) actuator positions at rest, rad; 0 m for the slider along the keyboard."""
    pull: FloatArray
    """(n,) weights of distances from them, per rad or m."""
    dynamics: HandDynamics
    """Its motion around the resting posture."""

    @classmethod
    def of(cls, scene: PianoScene, side: int, keys: KeyPlaces, n_substeps: int) -> Hand:
        """Find the posture of a hand (0 right, 1 left), fingertips over neighbouring white keys."""
        kinematics = HandKinematics(scene, side)
        rest = resting_posture(kinematics, keys)
        pull = _PULL * np.array([_firmness(name) for name in kinematics.names])
        dynamics = HandDynamics.of(scene, kinematics, rest, n_substeps)
        return cls(kinematics, keys, rest, pull, dynamics)


def resting_posture(kinematics: HandKinematics, keys: KeyPlaces) -> FloatArray:
    """Return the posture in which the fingertips lie over neighbouring white keys, (n,).

    It is sought once for all hands that are alike, which takes a tenth of a second.
    """
    return _sought(pickle.dumps(kinematics), float(np.min(keys.top)))


@functools.lru_cache(maxsize=16)
def _sought(pickled_kinematics: bytes, top: float) -> FloatArray:
    kinematics: HandKinematics = pickle.loads(pickled_kinematics)
    fingers = np.arange(FINGERS_PER_HAND) - MIDDLE
    across = kinematics.middle + kinematics.sign * KEY_SPACING * fingers
    along = np.full(FINGERS_PER_HAND, WHITE_X[1])
    along[THUMB] = WHITE_X[0]
    target = np.stack([along, across, np.full(FINGERS_PER_HAND, top + _HEIGHT)], axis=1)
    start = np.array([_start(name) for name in kinematics.names])
    held = np.array([10.0 if name in _HELD else 0.01 for name in kinematics.names])
    low, high = kinematics.low, kinematics.high
    rng = np.random.default_rng(0)

    def residuals(positions: FloatArray) -> FloatArray:
        off = kinematics.fingertips(positions[None])[0] - target
        return np.concatenate([10 * off.ravel(), held * (positions - start)])

    def slopes(positions: FloatArray) -> FloatArray:
        _, jacobian = kinematics.fingertips_and_jacobian(positions[None])
        return np.concatenate([10 * jacobian[0].reshape(target.size, -1), np.diag(held)])

    solutions = []
    for trial in range(_TRIALS):
        noise = 0.2 * rng.standard_normal(len(start)) if trial else 0.0
        guess = np.clip(start + noise, low + 1e-6, high - 1e-6)
        solutions.append(least_squares(residuals, guess, jac=slopes, bounds=(low, high)))
    best = min(solutions, key=lambda solution: float(solution.cost))
    posture = np.asarray(best.x)
    posture.flags.writeable = False
    return posture


def _start(name: str) -> float:
    """Return where the search begins for an actuator, rad or m."""
    if name in _HELD:
        return _HELD[name]
    ends = (end for end in _CURLED if name.endswith(end) and not (end == "J3" and name == "THJ3"))
    return _CURLED.get(next(ends, ""), 0.0)


def _firmness(name: str) -> float:
    spreads = name.endswith("J4") and name != "THJ4"
    return _FIRMNESS.get(name, _FIRMNESS_ABDUCTION if spreads else 1.0)
