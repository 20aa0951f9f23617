"""Follow a plan: its commands, corrected by where the hands are."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sb3_piano.planning.plan import Plan
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class Tracker:
    """Commands for each control step of a plan.

    Args:
        plan: The plan.
        scene: The scene that it was made for.
        feedback: Share of the optimal feedback that is used, 0 for none.
    """

    def __init__(self, plan: Plan, scene: PianoScene, feedback: float):
        self.plan = plan
        self.feed_forward = plan.commands
        """(T, n) the commands if all goes as planned, rad or m."""
        self._low, self._high = scene.ctrl_low, scene.ctrl_high
        self._feedback = feedback

    def __len__(self) -> int:
        return len(self.feed_forward)

    def controls(self, step: int, positions: npt.ArrayLike) -> FloatArray:
        """Return what to tell the actuators.

        Args:
            step: The control step that is to be played; after the last one it is the last.
            positions: (n,) where they are now, or (N, n) for N hands at once; rad or m.

        Returns:
            Commands of the same shape, within the control ranges.
        """
        step = min(step, len(self) - 1)
        ahead = np.asarray(positions, dtype=float) - self.plan.positions[step]
        half = ahead.shape[-1] // 2
        right, left = self.plan.gains
        correction = np.concatenate(
            [ahead[..., :half] @ right[step].T, ahead[..., half:] @ left[step].T], axis=-1
        )
        commands = self.feed_forward[step] - self._feedback * correction
        return np.clip(commands, self._low, self._high)
