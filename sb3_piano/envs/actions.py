"""Maps from actions to target positions of actuators, and back: absolute and relative ones."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.exceptions import InvalidActionError, one_line
from sb3_piano.settings import Positive, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.scene import tip_unit


class ActionMap:
    """Maps actions in [-1, 1] onto control ranges: actuators in the scene's order, pedal last."""

    def __init__(self, scene: PianoScene):
        """Take the control ranges of a scene's actuators."""
        self.middle = (scene.ctrl_high + scene.ctrl_low) / 2
        """(nu,) targets of an action of 0, rad or m."""
        self.half_range = (scene.ctrl_high - scene.ctrl_low) / 2
        """(nu,) change of the targets by an action of 1, rad or m."""
        self._shape = (len(self.middle) + 1,)
        self._low, self._high = np.full(self._shape, -1.0), np.ones(self._shape)
        self.space = spaces.Box(-1.0, 1.0, self._shape, dtype=np.float32)

    @property
    def rest(self) -> Float32Array:
        """Action that holds all joints at 0, or as near as their ranges allow, and the pedal up."""
        hands = np.clip(-self.middle / self.half_range, -1.0, 1.0)
        return np.append(hands, -1.0).astype(np.float32)

    def controls(self, action: npt.ArrayLike) -> tuple[FloatArray, float]:
        """Convert an action to control targets; values outside [-1, 1] are clipped.

        Returns:
            The actuators' targets, (nu,) rad or m, and the pedal's command in [0, 1].

        Raises:
            InvalidActionError: If the action has the wrong shape or is not finite.
        """
        array = action_numbers(action)
        if array.shape != self._shape:
            raise InvalidActionError(f"The action has shape {array.shape}: expected {self._shape}.")
        check_finite(array)
        clipped = np.minimum(np.maximum(array, self._low), self._high)
        return self.middle + self.half_range * clipped[:-1], (clipped.item(-1) + 1.0) / 2.0

    def action(self, controls: FloatArray, *, pedal_down: bool) -> Float32Array:
        """Compute the action for the actuators' targets, (nu,) rad or m, and the pedal."""
        hands = (controls - self.middle) / self.half_range
        return np.append(hands.astype(np.float32), np.float32(1.0 if pedal_down else -1.0))

    def change(self, controls: FloatArray) -> FloatArray:
        """Convert changes of the actuators' targets to changes of the action, (nu,)."""
        return controls / self.half_range


def action_numbers(action: npt.ArrayLike) -> FloatArray:
    """Convert an action to an array of float64.

    Raises:
        InvalidActionError: If it is no array of numbers, or some of its numbers are masked.
    """
    try:
        array = np.asarray(action)
        if array.dtype.kind == "c":  # NumPy would drop the imaginary part with a warning
            raise TypeError("they are complex")
        objects = array.flat if array.dtype.kind == "O" else ()
        if array.dtype.kind in "SUMm" or any(isinstance(one, str | bytes) for one in objects):
            raise TypeError("they are texts or dates")
        if np.ma.is_masked(action):
            raise TypeError("some are masked")
        return array.astype(np.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError) as error:
        text = one_line(error).rstrip(".")
        raise InvalidActionError(f"The action is not an array of numbers: {text}.") from error


def check_finite(action: FloatArray) -> None:
    """Raise an InvalidActionError unless all numbers of an action are finite."""
    finite = np.isfinite(action)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise InvalidActionError(
            f"Element {bad} of the action is {action[bad]}: expected numbers in [-1, 1]."
        )


REACH = 1.2
"""Default largest offset of a finger joint's target from its position, rad."""

# Target offsets that move a fingertip about as far in a control step of 0.05 s as 1 rad of a finger
# joint. In a step fingers cover two thirds of the offset, wrists a half, sliders 8 % (in m).
_UNIT = {"finger": 1.0, "wrist": 0.5, "forearm": 0.5, "elbow": tip_unit("elbow")}
_MIRRORED = ("along", "roll")  # mirrored in the left hand


class HandActionMap:
    """Maps actions relative to the present joint positions onto the actuators' targets.

    An action has one number in [-1, 1] for each actuator, in the scene's order. An actuator's
    target is its position plus its reach times the number, clipped to its control range. The left
    hand is mirrored: its slider along the keyboard and its forearm's roll have the opposite sign.
    """

    def __init__(self, scene: PianoScene, reach: float = REACH):
        """Take the actuators of a scene, and the reach of a finger joint, rad."""
        self.reach = checked("reach", reach, Positive) * hand_action_unit(scene)
        """(n,) offset by an action of 1, rad, or m for the sliders; negative if mirrored."""
        self._high = np.ones(self.reach.shape)
        self._low = -self._high
        self._ctrl_low, self._ctrl_high = scene.ctrl_low.copy(), scene.ctrl_high.copy()

    def controls(self, action: npt.NDArray[np.floating], positions: FloatArray) -> FloatArray:
        """Convert an action to the actuators' targets, (n,) rad or m; it is clipped to [-1, 1].

        ``positions`` are the actuators' present positions, (n,) rad or m.
        """
        offsets = np.minimum(np.maximum(action, self._low), self._high)
        controls = positions + self.reach * offsets
        return np.minimum(np.maximum(controls, self._ctrl_low), self._ctrl_high)

    def action(self, controls: FloatArray, positions: FloatArray) -> Float32Array:
        """Compute the action for (n,) targets of the actuators, clipped to the reach."""
        offsets = (controls - positions) / self.reach
        return np.minimum(np.maximum(offsets, self._low), self._high).astype(np.float32)


def hand_action_unit(scene: PianoScene) -> FloatArray:
    """Offsets that move fingertips equally, (n,) rad, or m for sliders; negative if mirrored."""
    unit = np.array([_UNIT[str(kind)] for kind in scene.actuator_kind])
    for role in _MIRRORED if "left" in scene.sides else ():
        of_role = np.flatnonzero(np.array(scene.actuator_role) == role)
        unit[of_role[-1:]] *= -1  # the left hand's is the last one, if any
    return unit
