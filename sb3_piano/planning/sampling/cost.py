"""Cost of a candidate: pure functions of what is due and of its motion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from sb3_piano.planning.sampling.settings import SamplingCost

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def key_cost(
    cost: SamplingCost, due: BoolArray, angles: FloatArray, sounding_angle: FloatArray
) -> FloatArray:
    """Return the cost of what the keys do at the end of a control step.

    Args:
        cost: What counts how much.
        due: (88,) bool, keys that should sound.
        angles: (m, 88) angle of each key, rad.
        sounding_angle: (88,) angle from which on each key sounds, rad.

    Returns:
        (m,) 0 or more.
    """
    sounding = angles >= sounding_angle
    down = np.minimum(angles / sounding_angle, 1.0)
    missing, pressed = 1.0 - down[:, due], down[:, ~due]
    return np.asarray(
        cost.missed * np.count_nonzero(~sounding[:, due], axis=1)
        + cost.wrong * np.count_nonzero(sounding[:, ~due], axis=1)
        + cost.reluctant * missing.sum(axis=1)
        + cost.brushed * (pressed * pressed).sum(axis=1)
    )


def mistakes(
    due: BoolArray, angles: FloatArray, sounding_angle: FloatArray
) -> npt.NDArray[np.intp]:
    """Return how many keys sound that should not, or do not that should.

    Args:
        due: (88,) bool, keys that should sound.
        angles: (m, 88) angle of each key, rad.
        sounding_angle: (88,) angle from which on each key sounds, rad.

    Returns:
        (m,) 0 to 88.
    """
    return np.count_nonzero((angles >= sounding_angle) != due, axis=1)


def plan_cost(
    cost: SamplingCost, planned: FloatArray, positions: FloatArray, deviation: FloatArray
) -> FloatArray:
    """Return the cost of being away from a plan.

    Args:
        cost: What counts how much.
        planned: (nu,) planned positions of the actuators, rad or m.
        positions: (m, nu) what they are.
        deviation: (nu,) standard deviation of each actuator's noise, rad or m; those with 0 are
            left out.

    Returns:
        (m,) from 0 to ``cost.astray``.
    """
    moved = deviation > 0
    away = (positions - planned)[:, moved] / (cost.tolerance * deviation[moved])
    return np.asarray(cost.astray * _mean(np.minimum(away * away, 1.0)))


def finger_cost(cost: SamplingCost, fingertips: FloatArray, points: FloatArray) -> FloatArray:
    """Return the cost of fingertips that are away from their keys.

    Args:
        cost: What counts how much.
        fingertips: (m, k, 3) positions of the fingertips that should press, m.
        points: (m, k, 3) where each should press, m.

    Returns:
        (m,) from 0 to k times ``cost.distance``.
    """
    return np.asarray(cost.distance * _farness(cost, fingertips - points).sum(axis=-1))


def any_finger_cost(cost: SamplingCost, fingertips: FloatArray, points: FloatArray) -> FloatArray:
    """Return the same where any finger may press: the least sum over all assignments.

    Args:
        cost: What counts how much.
        fingertips: (m, 10, 3) positions of all fingertips, m.
        points: (m, k, 3) where the keys should be pressed, m.

    Returns:
        (m,) from 0 to k times ``cost.distance``.
    """
    far = _farness(cost, fingertips[:, :, None] - points[:, None])
    return np.array([cost.distance * f[linear_sum_assignment(f)].sum() for f in far])


def effort_cost(cost: SamplingCost, change: FloatArray, deviation: FloatArray) -> FloatArray:
    """Return the cost of a change.

    Args:
        cost: What counts how much.
        change: (m, nu) what is added to the controls, rad or m.
        deviation: (nu,) standard deviation of each actuator's noise, rad or m; those with 0 are
            left out.

    Returns:
        (m,) 0 or more.
    """
    moved = deviation > 0
    size = change[:, moved] / deviation[moved]
    return np.asarray(cost.effort * _mean(size * size))


def _farness(cost: SamplingCost, offset: FloatArray) -> FloatArray:
    """Return 0 at a key, 0.5 at the reach, nearly 1 far away, for offsets along the last axis."""
    away = np.linalg.norm(offset, axis=-1)
    return np.asarray(away / (away + cost.reach))


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean along the last axis, 0 if there is nothing."""
    return np.asarray(values.sum(axis=-1) / max(values.shape[-1], 1))
