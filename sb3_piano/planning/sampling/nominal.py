"""Commands that candidates change: of a plan that is tracked, or of hands at rest."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from sb3_piano.planning.tracker import Tracker
from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class Nominal(Protocol):
    """A way of playing that needs no search."""

    def controls(self, step: int, positions: FloatArray) -> FloatArray:
        """Return what the actuators are told in a control step.

        Args:
            step: The control step.
            positions: (m, nu) where the actuators are at its beginning, rad or m.

        Returns:
            (m, nu) rad or m.
        """

    def planned(self, step: int) -> FloatArray | None:
        """Return where the actuators should be at the end of a control step, (nu,) rad or m.

        None if there is no plan: then the fingers are drawn to their keys instead.
        """


class Rest:
    """Hands that stay where an episode starts."""

    def __init__(self, scene: PianoScene):
        """Take the controls that hold all joints at 0, or as near as they can be."""
        self._controls = np.clip(np.zeros(scene.model.nu), scene.ctrl_low, scene.ctrl_high)

    def controls(self, step: int, positions: FloatArray) -> FloatArray:
        """Return the same for every step and wherever the actuators are, (m, nu)."""
        del step
        return np.broadcast_to(self._controls, positions.shape)

    def planned(self, step: int) -> None:
        """Return that there is no plan."""
        del step


class Tracked:
    """A plan, tracked with feedback."""

    def __init__(self, tracker: Tracker):
        """Take a tracker, which knows its plan."""
        self._tracker = tracker

    def controls(self, step: int, positions: FloatArray) -> FloatArray:
        """Return what the tracker would do at each of the positions, (m, nu)."""
        return self._tracker.controls(step, positions)

    def planned(self, step: int) -> FloatArray:
        """Return where the plan is after a control step, (nu,)."""
        return np.asarray(self._tracker.plan.positions[step + 1])
