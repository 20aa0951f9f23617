"""Cost of a candidate: weights, and pure functions of due keys and of its motion."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from annotated_types import Gt, Le
from scipy.optimize import linear_sum_assignment

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.settings import NotNegative, Number, Positive, settings


@settings
class SamplingCost:
    """Weights of a candidate's cost in each control step; less is better.

    Raises:
        ConfigError: If a value is out of range.
    """

    missed: NotNegative = 1.0
    """For each key that should sound and does not."""
    wrong: NotNegative = 1.5
    """For each key that sounds and should not."""
    reluctant: NotNegative = 0.5
    """For each key that should sound, times the missing share of its way to sounding."""
    brushed: NotNegative = 0.1
    """For each key that should not sound, times the squared share of its way to sounding (at most
    1)."""
    astray: NotNegative = 0.5
    """For the mean over the actuators of the squared distance from the plan (at most 1 each), in
    units of ``tolerance``; 0 without a plan."""
    tolerance: Positive = 3.0
    """Distance from the plan with full cost, in standard deviations of the noise."""
    distance: NotNegative = 1.0
    """Without a plan: for each key that should be pressed, times a measure of its finger's
    distance: 0 at the key, 0.5 at ``reach``, nearly 1 far away."""
    reach: Positive = 0.05
    """Distance of a finger from its key with half of the cost ``distance``, m."""
    effort: NotNegative = 0.01
    """For the mean square of the change, in standard deviations of the noise."""
    discount: Annotated[Number, Gt(0), Le(1)] = 0.9
    """Weight of each control step relative to the one before; above 0, at most 1."""

    def key_cost(
        self, due: BoolArray, angles: FloatArray, sounding_angle: FloatArray
    ) -> FloatArray:
        """Compute the cost of each key at the end of a control step.

        Args:
            due: (88,) bool, keys that should sound.
            angles: (m, 88) angle of each key, rad.
            sounding_angle: (88,) angle at and above which each key sounds, rad.

        Returns:
            (m, 88) 0 or more.
        """
        sounding = angles >= sounding_angle
        down = np.minimum(angles / sounding_angle, 1.0)
        return np.where(
            due,
            self.missed * ~sounding + self.reluctant * (1.0 - down),
            self.wrong * sounding + self.brushed * down * down,
        )

    def plan_cost(
        self, planned: FloatArray, positions: FloatArray, deviation: FloatArray
    ) -> FloatArray:
        """Compute the cost of deviations from a plan.

        Args:
            planned: (nu,) planned positions of the actuators, rad or m.
            positions: (m, nu) actual positions.
            deviation: (nu,) standard deviation of each actuator's noise, rad or m; actuators with 0
                are left out.

        Returns:
            (m,) from 0 to ``astray``.
        """
        moved = deviation > 0
        away = (positions - planned)[:, moved] / (self.tolerance * deviation[moved])
        return np.asarray(self.astray * _mean(np.minimum(away * away, 1.0)))

    def finger_cost(self, fingertips: FloatArray, points: FloatArray) -> FloatArray:
        """Compute the cost of the fingertips' distances from their keys.

        Args:
            fingertips: (m, k, 3) positions of the fingertips that should press, m.
            points: (m, k, 3) press point of each, m.

        Returns:
            (m,) from 0 to k times ``distance``.
        """
        return np.asarray(self.distance * self._farness(fingertips - points).sum(axis=-1))

    def any_finger_cost(self, fingertips: FloatArray, points: FloatArray) -> FloatArray:
        """Compute the same if any finger may press: the least sum over all assignments.

        Args:
            fingertips: (m, 10, 3) positions of all fingertips, m.
            points: (m, k, 3) press points of the keys, m.

        Returns:
            (m,) from 0 to k times ``distance``.
        """
        far = self._farness(fingertips[:, :, None] - points[:, None])
        return np.array([self.distance * f[linear_sum_assignment(f)].sum() for f in far])

    def effort_cost(self, change: FloatArray, deviation: FloatArray) -> FloatArray:
        """Compute the cost of a change.

        Args:
            change: (m, nu) change of the controls, rad or m.
            deviation: (nu,) standard deviation of each actuator's noise, rad or m; actuators with 0
                are left out.

        Returns:
            (m,) 0 or more.
        """
        moved = deviation > 0
        size = change[:, moved] / deviation[moved]
        return np.asarray(self.effort * _mean(size * size))

    def _farness(self, offset: FloatArray) -> FloatArray:
        """Return 0 at a key, 0.5 at the reach, nearly 1 far away, for (..., 3) offsets, m."""
        away = np.linalg.norm(offset, axis=-1)
        return np.asarray(away / (away + self.reach))


COST_FROM_ZERO = SamplingCost(wrong=1.0)
"""Cost for sampling without a plan; a higher cost of wrong keys makes it play less."""


def wrong_keys(due: BoolArray, angles: FloatArray, sounding_angle: FloatArray) -> IntArray:
    """Count the keys that sound wrongly or are missing.

    The arguments are those of :meth:`SamplingCost.key_cost`.

    Returns:
        (m,) 0 to 88.
    """
    return np.count_nonzero((angles >= sounding_angle) != due, axis=1)


def _mean(values: FloatArray) -> FloatArray:
    """Compute the mean along the last axis, 0 if it is empty."""
    return np.asarray(values.sum(axis=-1) / max(values.shape[-1], 1))
