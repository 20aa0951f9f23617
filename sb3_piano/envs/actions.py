"""Map from actions to target positions of all actuators and the pedal, and back."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.exceptions import InvalidActionError
from sb3_piano.simulation import PianoScene

ActionArray = npt.NDArray[np.float32]


class ActionMap:
    """Maps actions in [-1, 1] onto control ranges: actuators in the scene's order, pedal last."""

    def __init__(self, scene: PianoScene):
        """Take the control ranges of a scene's actuators."""
        self._middle = (scene.ctrl_high + scene.ctrl_low) / 2
        self._half_range = (scene.ctrl_high - scene.ctrl_low) / 2
        self._shape = (len(self._middle) + 1,)
        self._low, self._high = np.full(self._shape, -1.0), np.ones(self._shape)
        self.space = spaces.Box(-1.0, 1.0, self._shape, dtype=np.float32)

    @property
    def rest(self) -> npt.NDArray[np.float32]:
        """The action that holds all joints at 0, or as near as they can be, and the pedal up."""
        hands = np.clip(-self._middle / self._half_range, -1.0, 1.0)
        return np.append(hands, -1.0).astype(np.float32)

    def controls(self, action: npt.ArrayLike) -> tuple[npt.NDArray[np.float64], float]:
        """Return what an action commands; values outside [-1, 1] are clipped.

        Returns:
            The actuators' targets, (nu,) rad or m, and the pedal's command in [0, 1].

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        clipped = np.minimum(np.maximum(self._checked(action), self._low), self._high)
        return self._middle + self._half_range * clipped[:-1], (clipped.item(-1) + 1.0) / 2.0

    def action(self, controls: npt.NDArray[np.float64], *, pedal_down: bool) -> ActionArray:
        """Return the action that commands this, in [-1, 1] within the control ranges.

        Args:
            controls: (nu,) the actuators' targets, rad or m.
            pedal_down: Whether the sustain pedal is to be down.
        """
        hands = (controls - self._middle) / self._half_range
        return np.append(hands.astype(np.float32), np.float32(1.0 if pedal_down else -1.0))

    def change(self, controls: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return by how much an action changes where the actuators' targets do, (nu,)."""
        return controls / self._half_range

    def _checked(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        try:
            array = np.asarray(action)
            if array.dtype.kind == "c":  # of which NumPy would drop a half with a warning
                raise TypeError("they are complex")
            array = array.astype(np.float64)
        except (TypeError, ValueError) as error:
            raise InvalidActionError(f"The action is not an array of numbers: {error}.") from error
        if array.shape != self._shape:
            raise InvalidActionError(f"The action has shape {array.shape}: expected {self._shape}.")
        if not math.isfinite(array.dot(array)):  # one look at all; huge numbers are not finite here
            finite = np.isfinite(array)
            if not finite.all():
                bad = int(np.argmin(finite))
                raise InvalidActionError(
                    f"Element {bad} of the action is {array[bad]}: expected numbers in [-1, 1]."
                )
        return array
