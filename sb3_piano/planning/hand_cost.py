"""Residuals and Jacobians of one hand over s states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.music.hands import FINGERS_PER_HAND
from sb3_piano.planning.key_frames import KeyFrames
from sb3_piano.planning.kinematics import HandKinematics
from sb3_piano.planning.settings import PlanSettings

FloatArray = npt.NDArray[np.float64]

_X, _Y, _Z = range(3)
_TARGETS = slice(0, 3 * FINGERS_PER_HAND)
_IDLE = slice(15, 20)
_WALL = slice(20, 25)
_SPACING = slice(25, 29)
_ARMS = 29
_N_RESIDUALS = 30


@dataclass(eq=False)
class HandCost:
    """The sum of squared residuals of s states that say what is wrong with each of them.

    They are, per state: the fingertips' distances from their targets (15); how far those that have
    none hang down (5); how far fingertips are inside the row of black keys (5); how much
    neighbouring fingers (4) and the two arms (1) are too near to each other.
    """

    kinematics: HandKinematics
    frames: KeyFrames
    """Targets of the s states."""
    settings: PlanSettings
    bound: FloatArray
    """(s,) beyond which the arm must be (in the hand's own direction), m."""

    def __post_init__(self) -> None:
        self.sign = self.kinematics.sign
        self.idle = ~self.frames.weight.any(axis=2)  # (s, 5)

    def values(self, positions: FloatArray) -> FloatArray:
        """Return the residuals, (s, 30).

        Args:
            positions: (s, n) actuator positions.
        """
        return self._values(positions, self.kinematics.fingertips(positions))

    def bound_violation(self, positions: FloatArray) -> FloatArray:
        """Return the distance of the arm beyond its bound, (s,) m, 0 or more."""
        too_far_in = self.sign * (self.bound - self.kinematics.arm(positions))
        return np.asarray(np.maximum(too_far_in, 0))

    def quadratic(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the Gauss-Newton model of half the cost: (s, n, n) Hessians, (s, n) gradients.

        Args:
            positions: (s, n) actuator positions.
        """
        tips, jacobian = self.kinematics.fingertips_and_jacobian(positions)
        values = self._values(positions, tips)
        slopes = self._slopes(tips, jacobian, values)
        transposed = slopes.transpose(0, 2, 1)
        return transposed @ slopes, (transposed @ values[..., None])[..., 0]

    def _values(self, positions: FloatArray, tips: FloatArray) -> FloatArray:
        settings, frames = self.settings, self.frames
        values = np.empty((len(tips), _N_RESIDUALS))
        values[:, _TARGETS] = (frames.weight * (tips - frames.target)).reshape(len(tips), -1)
        hanging = np.maximum(settings.idle_height - tips[..., _Z], 0)
        values[:, _IDLE] = settings.weight_idle * hanging * self.idle
        too_near, too_low, forwards, upwards = self._inside_wall(tips)
        values[:, _WALL] = settings.weight_wall * (too_near * forwards + too_low * upwards)
        values[:, _SPACING] = settings.weight_spacing * self._too_close(tips)
        values[:, _ARMS] = settings.weight_arms * self.bound_violation(positions)
        return values

    def _slopes(self, tips: FloatArray, jacobian: FloatArray, values: FloatArray) -> FloatArray:
        """Return the residuals' derivatives, (s, 30, n)."""
        settings = self.settings
        count, size = len(tips), jacobian.shape[-1]
        slopes = np.empty((count, _N_RESIDUALS, size))
        weighted = self.frames.weight[..., None] * jacobian
        slopes[:, _TARGETS] = weighted.reshape(count, -1, size)
        active = (values[:, _IDLE] > 0)[..., None]
        slopes[:, _IDLE] = -settings.weight_idle * active * jacobian[:, :, _Z]
        _, _, forwards, upwards = self._inside_wall(tips)
        slopes[:, _WALL] = -settings.weight_wall * (
            forwards[..., None] * jacobian[:, :, _X] + upwards[..., None] * jacobian[:, :, _Z]
        )
        active = (values[:, _SPACING] > 0)[..., None]
        apart = self.sign * np.diff(jacobian[:, :, _Y], axis=1)
        slopes[:, _SPACING] = -settings.weight_spacing * active * apart
        active = (values[:, _ARMS] > 0)[:, None]
        slopes[:, _ARMS] = -settings.weight_arms * self.sign * active * self.kinematics.arm_slope
        return slopes

    def _too_close(self, tips: FloatArray) -> FloatArray:
        """Return how much neighbours are too close: thumb and index, then the fingers, (s, 4)."""
        gaps = self.sign * np.diff(tips[..., _Y], axis=1)
        least = np.full(FINGERS_PER_HAND - 1, self.settings.spacing)
        least[0] = self.settings.thumb_spacing
        return np.maximum(least - gaps, 0)

    def _inside_wall(
        self, tips: FloatArray
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return how far fingertips are inside the row of black keys, and which way leads out.

        Returns:
            Depths along x and z, (s, 5) m; and which fingers should go forwards or upwards.
        """
        settings = self.settings
        near = np.where(self.idle, settings.idle_x, settings.wall_x)
        low = np.where(
            self.idle, settings.idle_x_height, settings.wall_height + self.kinematics.radius
        )
        too_near = np.maximum(near - tips[..., _X], 0)
        too_low = np.maximum(low - tips[..., _Z], 0)
        inside = (too_near > 0) & (too_low > 0) & ~self.frames.on_black
        # Who is on the way to a black key takes the shorter way out, all others go forwards.
        upwards = inside & self.frames.to_black & ~self.idle & (too_low < too_near)
        return too_near, too_low, inside & ~upwards, upwards
