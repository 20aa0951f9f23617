"""Falling notes: bars that come down onto the keys as the notes fall due."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.metrics import Presses, presses_of
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.moment import MISSED_COLOR, PRESSED_COLOR, Color, Moment, finger_color
from sb3_piano.viewing.stage import PANEL, PANEL_FOOT, PANEL_TOP

_AHEAD = 2.8
"""Time before its onset at which a note appears, s."""

_HALF_WIDTH = {False: 0.0098, True: 0.0048}
"""Half the width of a bar, m, by whether its key is black."""
_HALF_DEPTH = 0.004
_GAP = 0.0015
"""Shortening of a bar at each end, m, which separates repeated notes."""
_RIM = 0.0025
"""Width of a rim, m."""

_PAST, _COMING = 1.0, 2.0
"""Range of music in a view that follows it, s before and after now."""
_LEAST_STRETCH, _LEAST_FOLLOWED = 0.5, 0.25
"""Least width of the visible keys, m, for the whole piece and for a view that follows."""


class Bar(NamedTuple):
    """A box in the scene."""

    centre: tuple[float, float, float]
    """Its centre, m."""
    half: tuple[float, float, float]
    """Half lengths of its edges, m."""
    color: Color
    """Its RGBA."""
    turn: FloatArray = np.eye(3).ravel()
    """(9,) its rotation matrix, row by row."""


class Falling(NamedTuple):
    """A note that comes down."""

    key: int
    """Its key."""
    low: float
    high: float
    """Its lower and upper end, from 0 at the keys to 1 where notes appear."""
    color: Color
    """Its RGBA."""
    rim: Color | None = None
    """RGBA of its rim, if any."""


class Stretch(NamedTuple):
    """A part of the keyboard."""

    middle: float
    """Position of the middle along the keyboard, m."""
    width: float
    """Distance between its ends, m."""


@dataclass(frozen=True, eq=False)
class NoteBars:
    """The notes of a roll over the keys of a scene."""

    roll: PianoRoll
    """The roll that is due."""
    notes: Presses
    """Runs of steps in which keys are due."""
    key_y: FloatArray
    """(88,) positions of the keys along the keyboard, m."""
    whole: Stretch
    """The part of the keyboard that the piece uses."""
    near: tuple[FloatArray, FloatArray]
    """Middles and widths, (t + 1,) m each, of the due keys around each control step."""

    @classmethod
    def over(cls, scene: PianoScene, roll: PianoRoll) -> NoteBars:
        """Place the notes of a roll above the keys of a scene."""
        key_y = scene.key_boxes[0][:, 1]
        used = key_y[roll.active.any(axis=0)]
        ends = (used.min(), used.max()) if len(used) else (key_y[0], key_y[-1])
        return cls(
            roll=roll,
            notes=presses_of(roll.active),
            key_y=key_y,
            whole=_stretch(*ends, _LEAST_STRETCH),
            near=_near(roll, key_y),
        )

    def falling(self, step: float, sounding: BoolArray | None) -> list[Falling]:
        """Return the visible notes after a number of control steps.

        After the first step of a note, it has a rim if its key is among the (88,) sounding keys,
        and is grey if not, unless these are ``None``.
        """
        first, end, period = self.notes.first, self.notes.end, self.roll.control_timestep
        seen = np.flatnonzero((end > step) & ((first - step) * period < _AHEAD))
        falling = []
        for note in seen.tolist():
            key, start = int(self.notes.key[note]), int(first[note])
            color, rim = finger_color(int(self.roll.finger[start, key])), None
            if start < step and sounding is not None:
                color, rim = (color, PRESSED_COLOR) if sounding[key] else (MISSED_COLOR, None)
            ends = (max(start - step, 0), min((int(end[note]) - step), _AHEAD / period))
            low, high = (steps * period / _AHEAD for steps in ends)
            falling.append(Falling(key, low, high, color, rim))
        return falling

    def at(self, step: float, sounding: BoolArray | None) -> list[Bar]:
        """Return the same notes as bars in front of the panel."""
        bars, height = [], PANEL_TOP - PANEL_FOOT
        for key, low, high, color, rim in self.falling(step, sounding):
            depth, wide = _HALF_DEPTH, _HALF_WIDTH[bool(KEY_IS_BLACK[key])]
            long = max((high - low) / 2 * height - _GAP, _GAP)
            centre = (PANEL + depth, float(self.key_y[key]), PANEL_FOOT + (low + high) / 2 * height)
            if rim is not None:
                bars.append(Bar(centre, (depth, wide, long), rim))
                depth, wide, long = depth + 2e-4, wide - _RIM, max(long - _RIM, _GAP / 2)
            bars.append(Bar(centre, (depth, wide, long), color))
        return bars

    def followed(self, step: float) -> Stretch:
        """Return the part of the keyboard that is due around a time, in control steps."""
        steps = np.arange(len(self.near[0]))
        middle, width = (float(np.interp(step, steps, ends)) for ends in self.near)
        return Stretch(middle, width)


def finger_plates(scene: PianoScene, data: mujoco.MjData, moment: Moment) -> list[Bar]:
    """Return a plate for each key that sounds rightly, in the colour of its finger.

    It leaves a rim of the key, which is green.
    """
    plates = []
    for key, finger in zip(moment.due.tolist(), moment.fingers.tolist(), strict=True):
        if moment.sounding is None or not moment.sounding[key]:
            continue
        geom = int(scene.key_geom[key])
        turn, half = data.geom_xmat[geom], scene.model.geom_size[geom]
        top = data.geom_xpos[geom] + turn.reshape(3, 3)[:, 2] * half[2]
        inset = (half[0] - _RIM, half[1] - _RIM * (0.6 if KEY_IS_BLACK[key] else 1.0), 3e-4)
        plates.append(Bar(tuple(top), inset, finger_color(finger), turn))
    return plates


def draw_notes(
    picture: npt.NDArray[np.uint8], notes: list[Falling], place: FloatArray, scale: float
) -> None:
    """Draw falling notes into the upper part of a picture.

    Args:
        picture: (height, width, 3) uint8, changed in place; its lowest row is at the keys.
        notes: The notes.
        place: (88,) the columns of the keys' middles.
        scale: Pixels to a metre of the keyboard.
    """
    height = len(picture)
    for key, low, high, color, rim in notes:
        wide = max(_HALF_WIDTH[bool(KEY_IS_BLACK[key])] * scale, 1.0)
        gap, edge = _GAP * scale, max(_RIM * scale, 1.0)
        top, foot = height * (1 - high) + gap, height * (1 - low) - gap
        ends = place[key] - wide, place[key] + wide
        if rim is not None:
            _fill(picture, (*ends, top, foot), rim)
            top, foot, ends = top + edge, foot - edge, (ends[0] + edge, ends[1] - edge)
        _fill(picture, (*ends, top, foot), color)


def _fill(picture: npt.NDArray[np.uint8], box: tuple[float, ...], color: Color) -> None:
    """Fill a rectangle (left, right, top, foot) whose upper and lower edges are smooth."""
    left, right = round(box[0]), round(box[1])
    top, foot = max(box[2], 0.0), min(box[3], len(picture))
    if foot <= top or left >= right or right <= 0:
        return
    first, last = int(top), math.ceil(foot) - 1
    part: npt.NDArray[Any] = picture[: last + 1, max(left, 0) : right]
    tone = 255 * np.array(color[:3])
    part[first + 1 : last] = tone
    for row in {first, last}:
        share = min(row + 1, foot) - max(row, top)
        part[row] = part[row] + (tone - part[row]) * share


def _stretch(low: float, high: float, least: float) -> Stretch:
    return Stretch((low + high) / 2, max(high - low, least))


def _near(roll: PianoRoll, key_y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute middles and widths of the due keys around each time, with smooth changes."""
    # Here, as it takes 0.3 s and environments import this module.
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

    due = roll.active.any(axis=1)
    steps = np.arange(len(roll) + 1)
    if not due.any():
        whole = _stretch(key_y[0], key_y[-1], _LEAST_FOLLOWED)
        return np.full(len(steps), whole.middle), np.full(len(steps), whole.width)
    lowest, highest = roll.active.argmax(axis=1), roll.active[:, ::-1].argmax(axis=1)
    window = round((_PAST + _COMING) / roll.control_timestep)
    # A filter is symmetric unless its origin is moved.
    origin = -round((_COMING - _PAST) / 2 / roll.control_timestep)
    ends = []
    for place, widest in (
        (key_y[lowest], minimum_filter1d),
        (key_y[::-1][highest], maximum_filter1d),
    ):
        held = np.interp(steps, np.flatnonzero(due), place[due])
        reached = widest(held, window, mode="nearest", origin=origin)
        ends.append(gaussian_filter1d(reached, window / 4, mode="nearest"))
    low, high = ends
    return (low + high) / 2, np.maximum(high - low, _LEAST_FOLLOWED)
