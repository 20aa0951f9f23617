"""Cost of a candidate: weights, and pure functions of what is due and of its motion."""

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
    """For each key that should sound, times the share of the way to sounding that is missing."""
    brushed: NotNegative = 0.1
    """For each key that should not sound, times the square of the share of the way that it is down
    (at most 1)."""
    astray: NotNegative = 0.5
    """Times the mean over the actuators of the squared distance from the plan (at most 1 each), in
    units of ``tolerance``; nothing without a plan."""
    tolerance: Positive = 3.0
    """Distance from the plan that counts in full, in standard deviations of the noise."""
    distance: NotNegative = 1.0
    """Without a plan: for each key that should be pressed, times how far its finger is away: 0 at
    the key, 0.5 at a distance of ``reach``, nearly 1 far away."""
    reach: Positive = 0.05
    """Distance of a finger from its key at which half of ``distance`` counts, m."""
    effort: NotNegative = 0.01
    """Times the mean square of the change, in standard deviations of the noise."""
    discount: Annotated[Number, Gt(0), Le(1)] = 0.9
    """Weight of each control step relative to the one before; above 0, at most 1."""

    def key_cost(
        self, due: BoolArray, angles: FloatArray, sounding_angle: FloatArray
    ) -> FloatArray:
        """Return the cost of what each key does at the end of a control step.

        Args:
            due: (88,) bool, keys that should sound.
            angles: (m, 88) angle of each key, rad.
            sounding_angle: (88,) angle from which on each key sounds, rad.

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
        """Return the cost of being away from a plan.

        Args:
            planned: (nu,) planned positions of the actuators, rad or m.
            positions: (m, nu) what they are.
            deviation: (nu,) standard deviation of each actuator's noise, rad or m; those with 0 are
                left out.

        Returns:
            (m,) from 0 to ``astray``.
        """
        moved = deviation > 0
        away = (positions - planned)[:, moved] / (self.tolerance * deviation[moved])
        return np.asarray(self.astray * _mean(np.minimum(away * away, 1.0)))

    def finger_cost(self, fingertips: FloatArray, points: FloatArray) -> FloatArray:
        """Return the cost of fingertips that are away from their keys.

        Args:
            fingertips: (m, k, 3) positions of the fingertips that should press, m.
            points: (m, k, 3) where each should press, m.

        Returns:
            (m,) from 0 to k times ``distance``.
        """
        return np.asarray(self.distance * self._farness(fingertips - points).sum(axis=-1))

    def any_finger_cost(self, fingertips: FloatArray, points: FloatArray) -> FloatArray:
        """Return the same where any finger may press: the least sum over all assignments.

        Args:
            fingertips: (m, 10, 3) positions of all fingertips, m.
            points: (m, k, 3) where the keys should be pressed, m.

        Returns:
            (m,) from 0 to k times ``distance``.
        """
        far = self._farness(fingertips[:, :, None] - points[:, None])
        return np.array([self.distance * f[linear_sum_assignment(f)].sum() for f in far])

    def effort_cost(self, change: FloatArray, deviation: FloatArray) -> FloatArray:
        """Return the cost of a change.

        Args:
            change: (m, nu) what is added to the controls, rad or m.
            deviation: (nu,) standard deviation of each actuator's noise, rad or m; those with 0 are
                left out.

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
"""Cost for sampling without a plan, which with dearer wrong keys plays less."""


def wrong_keys(due: BoolArray, angles: FloatArray, sounding_angle: FloatArray) -> IntArray:
    """Return how many keys sound that should not, or do not that should: (m,), 0 to 88.

    The arguments are those of :meth:`SamplingCost.key_cost`.

    Returns:
        (m,) 0 to 88.
    """
    return np.count_nonzero((angles >= sounding_angle) != due, axis=1)


def _mean(values: FloatArray) -> FloatArray:
    """Return the mean along the last axis, 0 if there is nothing."""
    return np.asarray(values.sum(axis=-1) / max(values.shape[-1], 1))
