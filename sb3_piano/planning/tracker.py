"""Tracker of a plan: its commands with feedback on the hands' positions."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.planning.correction import Correction
from sb3_piano.simulation import PianoScene

if TYPE_CHECKING:
    from sb3_piano.planning.plan import Plan

# Smaller deviations, rad or m, are rounding errors of observations. Feedback on them would change a
# motion found in simulation, as playing is chaotic.
_ROUNDING = 1e-5


class Tracker:
    """Commands for each control step of a plan, corrected (:class:`Correction`)."""

    def __init__(self, plan: Plan, scene: PianoScene, feedback: float, lift: float = 0.0):
        self.plan = plan
        self._low, self._high = scene.ctrl_low, scene.ctrl_high
        self._correction = Correction(plan.hands, feedback, lift)

    def positions(self, joints: npt.ArrayLike) -> FloatArray:
        """Compute the actuator positions for :meth:`controls` (see :class:`Correction`)."""
        return self._correction.positions(np.asarray(joints, dtype=float))

    def controls(self, step: int, positions: npt.ArrayLike) -> FloatArray:
        """Compute the commands of the actuators.

        Args:
            step: The next control step; steps after the end count as the last one.
            positions: (n,) present positions, or (N, n) for N scenes at once; rad or m.

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
