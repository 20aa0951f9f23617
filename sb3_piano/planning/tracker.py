"""Follow a plan: its commands, corrected by where the hands are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.planning.correction import Correction
from sb3_piano.simulation import PianoScene

if TYPE_CHECKING:
    from sb3_piano.planning.plan import Plan

# Less than this, rad or m, is the rounding of an observation, after which a motion that was found
# in simulation would not come out again: playing is chaotic.
_ROUNDING = 1e-5


class Tracker:
    """Commands for each control step of a plan, corrected (:class:`Correction`)."""

    def __init__(self, plan: Plan, scene: PianoScene, feedback: float, lift: float = 0.0):
        self.plan = plan
        self._low, self._high = scene.ctrl_low, scene.ctrl_high
        self._correction = Correction(plan.hands, feedback, lift)

    def positions(self, joints: npt.ArrayLike) -> FloatArray:
        """Return where the actuators are as :meth:`controls` takes it (:class:`Correction`)."""
        return self._correction.positions(np.asarray(joints, dtype=float))

    def controls(self, step: int, positions: npt.ArrayLike) -> FloatArray:
        """Return what to tell the actuators.

        Args:
            step: The control step that is to be played; after the last one it is the last.
            positions: (n,) where they are now, or (N, n) for N scenes at once; rad or m.

        Returns:
            Commands of the same shape, within the control ranges.
        """
        plan = self.plan
        step = min(step, len(plan.commands) - 1)
        ahead = np.asarray(positions, dtype=float) - plan.positions[step]
        if plan.passes > 0:
            ahead[np.abs(ahead) < _ROUNDING] = 0.0
        commands = plan.commands[step] + self._correction(step, ahead)
        return np.clip(commands, self._low, self._high)
