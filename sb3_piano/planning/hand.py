"""Planner's model of a hand: kinematics, resting posture, and linear dynamics."""

from __future__ import annotations

import functools
import pickle
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sb3_piano.arrays import FloatArray
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.music.constants import MIDDLE, THUMB
from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.planning.arm import Arm
from sb3_piano.planning.tracking_control import HandDynamics
from sb3_piano.reading.key_frames import WHITE_X, KeyPlaces
from sb3_piano.simulation import PianoScene

# Joints fixed in the search, rad or m: elbows point outwards, so that both hands have room.
_HELD = {"yaw": -0.1, "roll": 0.0, "pitch": 0.0, "up": 0.0}
_TRIALS = 2

_PULL = 0.01  # weight of a finger's distance from the resting posture, per rad
# The same by role, as multiples of that: the arm is nearly free.
_FIRMNESS = {"along": 0.01, "across": 2.0, "wrist": 2.0, "abduction": 1.5, "finger": 1.0}
# Forearms that turn with every note play worse than those that only give way to the other one.
_FIRMNESS |= dict.fromkeys(("up", "roll", "pitch", "yaw"), 1000.0)


@dataclass(frozen=True, eq=False)
class Hand:
    """Model of one hand around its rest over neighbouring white keys."""

    kinematics: HandKinematics
    """Its kinematics."""
    arm: Arm
    """Its forearm."""
    keys: KeyPlaces
    """The keyboard under it."""
    rest: FloatArray
    """(n,) actuator positions at rest, rad; 0 m for the slider along the keyboard."""
    pull: FloatArray
    """(n,) weights of distances from ``rest``, per rad or m."""
    dynamics: HandDynamics
    """Its linear dynamics around the resting posture."""

    @classmethod
    def of(cls, scene: PianoScene, side: int, keys: KeyPlaces, n_substeps: int) -> Hand:
        """Make the model of a hand (0 right, 1 left) in a scene."""
        kinematics = HandKinematics(scene, side)
        rest = resting_posture(kinematics, keys)
        pull = _PULL * np.array([_FIRMNESS[role] for role in kinematics.roles])
        dynamics = HandDynamics.of(scene, kinematics, rest, n_substeps)
        return cls(kinematics, Arm(scene, kinematics), keys, rest, pull, dynamics)


def resting_posture(kinematics: HandKinematics, keys: KeyPlaces) -> FloatArray:
    """Find the posture with the fingertips over neighbouring white keys, (n,).

    The search takes a tenth of a second, once for all equal hands.
    """
    return _sought(pickle.dumps(kinematics), float(np.min(keys.top)))


@functools.lru_cache(maxsize=16)
def _sought(pickled_kinematics: bytes, top: float) -> FloatArray:
    kinematics: HandKinematics = pickle.loads(pickled_kinematics)
    count, rest = len(kinematics.radius), kinematics.spec.rest
    fingers = np.arange(count) - MIDDLE
    across = kinematics.middle + kinematics.sign * KEY_SPACING * fingers
    along = np.full(count, WHITE_X[1])
    along[THUMB] = WHITE_X[0]
    target = np.stack([along, across, np.full(count, top + rest.height)], axis=1)
    start = np.array([rest.posture.get(name, 0.0) for name in kinematics.names])
    is_held = np.isin(kinematics.roles, list(_HELD))
    start[is_held] = [_HELD[role] for role in kinematics.roles if role in _HELD]
    held = np.where(is_held, 10.0, 0.01)
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
