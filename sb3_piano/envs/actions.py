"""Map from actions to target positions of all actuators and the pedal, and back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.exceptions import InvalidActionError, one_line
from sb3_piano.settings import Positive, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import tip_unit

REACH = 1.2
"""How far from where it is hands send a finger's joint at most, rad, unless told otherwise."""

# What moves a fingertip about as far in a control step of 0.05 s, relative to a rad of a finger's
# joint: of what they are told fingers follow two thirds, wrists a half, sliders 8 % (these in m).
_UNIT = {"finger": 1.0, "wrist": 0.5, "forearm": 0.5, "elbow": tip_unit("elbow")}
_MIRRORED = ("along", "roll")  # the left hand's move the other way


class ActionMap:
    """Maps actions in [-1, 1] onto control ranges: actuators in the scene's order, pedal last."""

    def __init__(self, scene: PianoScene):
        """Take the control ranges of a scene's actuators."""
        self.middle = (scene.ctrl_high + scene.ctrl_low) / 2
        """(nu,) targets of an action of 0, rad or m."""
        self.half_range = (scene.ctrl_high - scene.ctrl_low) / 2
        """(nu,) what an action of 1 adds, rad or m."""
        self._shape = (len(self.middle) + 1,)
        self._low, self._high = np.full(self._shape, -1.0), np.ones(self._shape)
        self.space = spaces.Box(-1.0, 1.0, self._shape, dtype=np.float32)

    @property
    def rest(self) -> Float32Array:
        """The action that holds all joints at 0, or as near as they can be, and the pedal up."""
        hands = np.clip(-self.middle / self.half_range, -1.0, 1.0)
        return np.append(hands, -1.0).astype(np.float32)

    def controls(self, action: npt.ArrayLike) -> tuple[FloatArray, float]:
        """Return what an action commands; values outside [-1, 1] are clipped.

        Returns:
            The actuators' targets, (nu,) rad or m, and the pedal's command in [0, 1].

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        clipped = np.minimum(np.maximum(self._checked(action), self._low), self._high)
        return self.middle + self.half_range * clipped[:-1], (clipped.item(-1) + 1.0) / 2.0

    def action(self, controls: FloatArray, *, pedal_down: bool) -> Float32Array:
        """Return the action that commands the actuators' targets, (nu,) rad or m, and the pedal."""
        hands = (controls - self.middle) / self.half_range
        return np.append(hands.astype(np.float32), np.float32(1.0 if pedal_down else -1.0))

    def change(self, controls: FloatArray) -> FloatArray:
        """Return by how much an action changes where the actuators' targets do, (nu,)."""
        return controls / self.half_range

    def _checked(self, action: npt.ArrayLike) -> FloatArray:
        array = action_numbers(action)
        if array.shape != self._shape:
            raise InvalidActionError(f"The action has shape {array.shape}: expected {self._shape}.")
        check_finite(array)
        return array


def action_numbers(action: npt.ArrayLike) -> FloatArray:
    """Return an action as an array of float64.

    Raises:
        InvalidActionError: If it is none, or some of its numbers are masked.
    """
    try:
        array = np.asarray(action)
        if array.dtype.kind == "c":  # of which NumPy would drop a half with a warning
            raise TypeError("they are complex")
        if array.dtype.kind in "SUMm" or any(isinstance(x, str | bytes) for x in _objects(array)):
            raise TypeError("they are texts or dates")
        if np.ma.is_masked(action):
            raise TypeError("some are masked")
        return array.astype(np.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:
        text = one_line(error).rstrip(".")
        raise InvalidActionError(f"The action is not an array of numbers: {text}.") from error


def _objects(array: npt.NDArray[Any]) -> Iterable[Any]:
    return array.flat if array.dtype.kind == "O" else ()


def check_finite(action: FloatArray) -> None:
    """Refuse an action of which a number is not finite.

    Raises:
        InvalidActionError: If one is.
    """
    finite = np.isfinite(action)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise InvalidActionError(
            f"Element {bad} of the action is {action[bad]}: expected numbers in [-1, 1]."
        )


class HandActionMap:
    """Maps actions of right hands, which begin where a hand is, onto the actuators' targets.

    An action has one number in [-1, 1] for each actuator, in the scene's order. An actuator is told
    where it is plus its reach times the number, cut at the ends of its control range. The left hand
    is a right one in the mirror: its slider along the keyboard moves the other way, and so does the
    roll of its forearm.
    """

    def __init__(self, scene: PianoScene, reach: float = REACH):
        """Take the actuators of a scene.

        Args:
            scene: Where they are.
            reach: How far from where it is an action of 1 sends a finger's joint, rad, above 0; a
                wrist's joint half as far, a slider half as many metres, since it follows slowly, a
                forearm's turn 0.15 of it.

        Raises:
            ConfigError: If ``reach`` is out of range.
        """
        self.reach = checked("reach", reach, Positive) * hand_action_unit(scene)
        """(n,) what an action of 1 adds, rad, or m for the sliders; negative in the mirror."""
        shape = self.reach.shape
        self._low, self._high = np.full(shape, -1.0), np.ones(shape)
        self._ctrl_low, self._ctrl_high = scene.ctrl_low.copy(), scene.ctrl_high.copy()
        self.space = spaces.Box(-1.0, 1.0, shape, dtype=np.float32)

    def controls(self, action: npt.NDArray[np.floating], positions: FloatArray) -> FloatArray:
        """Return the actuators' targets, (n,) rad or m; what is outside of [-1, 1] is clipped.

        ``positions`` are where the actuators are, (n,) rad or m.
        """
        offsets = np.minimum(np.maximum(action, self._low), self._high)
        controls = positions + self.reach * offsets
        return np.minimum(np.maximum(controls, self._ctrl_low), self._ctrl_high)

    def action(self, controls: FloatArray, positions: FloatArray) -> Float32Array:
        """Return the action for (n,) targets of the actuators; what is beyond the reach is cut."""
        offsets = (controls - positions) / self.reach
        return np.minimum(np.maximum(offsets, self._low), self._high).astype(np.float32)


def hand_action_unit(scene: PianoScene) -> FloatArray:
    """Return what moves fingertips alike, (n,) rad, or m for sliders; negative in the mirror."""
    unit = np.array([_UNIT[str(kind)] for kind in scene.actuator_kind])
    for role in _MIRRORED if "left" in scene.sides else ():
        of_role = np.flatnonzero(np.array(scene.actuator_role) == role)
        unit[of_role[-1:]] *= -1  # the left hand's, which is the last one, if it has any
    return unit
