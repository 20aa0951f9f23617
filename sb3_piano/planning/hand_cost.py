"""Residuals and Jacobians of one hand over s states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.planning.arm import Arm
from sb3_piano.reading.key_frames import KeyFrames

_X, _Y, _Z = range(3)

# A black key's top is at a height of 0.035 m.
_IDLE_HEIGHT, _IDLE_WEIGHT = 0.047, 5.0  # least height of idle fingertips, m; weight, per m
_IDLE_X, _IDLE_X_HEIGHT = 0.030, 0.052  # their least height nearer to the hinges than x, m
_WALL_X, _WALL_HEIGHT = 0.0235, 0.037  # the same for playing fingertips, plus their radius
_WALL_WEIGHT = 5.0  # of coming nearer, per m
_SPACING_WEIGHT = 3.0  # of falling short of the least gaps of neighbours, per m
_ARMS_WEIGHT = 40.0  # of an arm beyond its bound, per m


@dataclass(eq=False)
class HandCost:
    """Cost of a hand's motion: the sum of squared residuals of s states.

    The residuals of each state, for a hand with f fingers, are the fingertips' distances from their
    targets (3 f), the missing heights of idle fingertips (f), the depths of fingertips inside the
    row of black keys (f), and the missing distances of neighbouring fingers (f - 1) and arms (1).
    """

    kinematics: HandKinematics
    arm: Arm
    frames: KeyFrames
    """Targets of the s states."""
    bound: FloatArray
    """(s,) place beyond which the arm must stay (in the hand's own direction), m."""

    def __post_init__(self) -> None:
        self.sign = self.kinematics.sign
        self.idle = ~self.frames.weight.any(axis=2)  # (s, f)
        self._gaps = np.array(self.kinematics.spec.reach.gaps)
        f = len(self.kinematics.radius)
        self._count = 6 * f
        self._targets, self._idle = slice(3 * f), slice(3 * f, 4 * f)
        self._wall, self._spacing = slice(4 * f, 5 * f), slice(5 * f, 6 * f - 1)

    def values(self, positions: FloatArray) -> FloatArray:
        """Compute the residuals of (s, n) actuator positions, (s, 6 f)."""
        return self._values(positions, self.kinematics.fingertips(positions))

    def bound_violation(self, positions: FloatArray) -> FloatArray:
        """Compute the distance of the arm beyond its bound, (s,) m, 0 or more."""
        too_far_in = self.sign * (self.bound - self.arm.place(positions))
        return np.asarray(np.maximum(too_far_in, 0))

    def quadratic(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the Gauss-Newton model of half the cost: (s, n, n) Hessians, (s, n) gradients."""
        tips, jacobian = self.kinematics.fingertips_and_jacobian(positions)
        values = self._values(positions, tips)
        slopes = self._slopes(positions, tips, jacobian, values)
        transposed = slopes.transpose(0, 2, 1)
        return transposed @ slopes, (transposed @ values[..., None])[..., 0]

    def _values(self, positions: FloatArray, tips: FloatArray) -> FloatArray:
        frames = self.frames
        values = np.empty((len(tips), self._count))
        values[:, self._targets] = (frames.weight * (tips - frames.target)).reshape(len(tips), -1)
        hanging = np.maximum(_IDLE_HEIGHT - tips[..., _Z], 0)
        values[:, self._idle] = _IDLE_WEIGHT * hanging * self.idle
        too_near, too_low, forwards, upwards = self._inside_wall(tips)
        values[:, self._wall] = _WALL_WEIGHT * (too_near * forwards + too_low * upwards)
        values[:, self._spacing] = _SPACING_WEIGHT * self._too_close(tips)
        values[:, -1] = _ARMS_WEIGHT * self.bound_violation(positions)
        return values

    def _slopes(
        self, positions: FloatArray, tips: FloatArray, jacobian: FloatArray, values: FloatArray
    ) -> FloatArray:
        """Compute the residuals' derivatives, (s, 6 f, n)."""
        count, size = len(tips), jacobian.shape[-1]
        slopes = np.empty((count, self._count, size))
        weighted = self.frames.weight[..., None] * jacobian
        slopes[:, self._targets] = weighted.reshape(count, -1, size)
        active = (values[:, self._idle] > 0)[..., None]
        slopes[:, self._idle] = -_IDLE_WEIGHT * active * jacobian[:, :, _Z]
        _, _, forwards, upwards = self._inside_wall(tips)
        slopes[:, self._wall] = -_WALL_WEIGHT * (
            forwards[..., None] * jacobian[:, :, _X] + upwards[..., None] * jacobian[:, :, _Z]
        )
        active = (values[:, self._spacing] > 0)[..., None]
        apart = self.sign * np.diff(jacobian[:, :, _Y], axis=1)
        slopes[:, self._spacing] = -_SPACING_WEIGHT * active * apart
        active = (values[:, -1] > 0)[:, None]
        slopes[:, -1] = -_ARMS_WEIGHT * self.sign * active * self.arm.slopes(positions)
        return slopes

    def _too_close(self, tips: FloatArray) -> FloatArray:
        """Compute the missing distances of neighbours, from the thumb on, (s, f - 1)."""
        gaps = self.sign * np.diff(tips[..., _Y], axis=1)
        return np.maximum(self._gaps - gaps, 0)

    def _inside_wall(self, tips: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray, BoolArray]:
        """Compute the depths of fingertips inside the row of black keys, and their ways out.

        Returns:
            Depths along x and z, (s, f) m; and which fingers should go forwards or upwards.
        """
        near = np.where(self.idle, _IDLE_X, _WALL_X)
        low = np.where(self.idle, _IDLE_X_HEIGHT, _WALL_HEIGHT + self.kinematics.radius)
        too_near = np.maximum(near - tips[..., _X], 0)
        too_low = np.maximum(low - tips[..., _Z], 0)
        inside = (too_near > 0) & (too_low > 0) & ~self.frames.on_black
        # Fingers that move to a black key take the shorter way out; all others go forwards.
        upwards = inside & self.frames.to_black & ~self.idle & (too_low < too_near)
        return too_near, too_low, inside & ~upwards, upwards
