"""Falling notes: bars that come down onto the keys as the notes fall due."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.metrics import Presses, presses_of
from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.moment import MISSED_COLOR, PRESSED_COLOR, Color, finger_color
from sb3_piano.viewing.stage import PANEL, PANEL_FOOT, PANEL_TOP

_AHEAD = 2.8
"""Time before its onset at which a note appears, s."""
_SPEED = (PANEL_TOP - PANEL_FOOT) / _AHEAD

_HALF_WIDTH = {False: 0.0098, True: 0.0048}
"""Half the width of a bar, m, by whether its key is black."""
_HALF_DEPTH = 0.004
_GAP = 0.0015
"""Shortening of a bar at each end, m, which separates repeated notes."""

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

    def at(self, step: int, sounding: BoolArray | None) -> list[Bar]:
        """Return the bars after a number of control steps.

        After the first step of a note, its bar is coloured by whether its key is among the (88,)
        sounding keys, unless these are ``None``.
        """
        first, end, period = self.notes.first, self.notes.end, self.roll.control_timestep
        seen = np.flatnonzero((end > step) & ((first - step) * period < _AHEAD))
        bars = []
        for note in seen.tolist():
            key, begun = int(self.notes.key[note]), int(first[note]) < step
            low = max(int(first[note]) - step, 0) * period * _SPEED
            high = min((int(end[note]) - step) * period, _AHEAD) * _SPEED
            color = finger_color(int(self.roll.finger[first[note], key]))
            if begun and sounding is not None:
                color = PRESSED_COLOR if sounding[key] else MISSED_COLOR
            bars.append(
                Bar(
                    (PANEL + _HALF_DEPTH, float(self.key_y[key]), PANEL_FOOT + (low + high) / 2),
                    (
                        _HALF_DEPTH,
                        _HALF_WIDTH[bool(KEY_IS_BLACK[key])],
                        max((high - low) / 2 - _GAP, _GAP),
                    ),
                    color,
                )
            )
        return bars

    def followed(self, step: int) -> Stretch:
        """Return the part of the keyboard that is due around a time, in control steps."""
        middle, width = self.near
        step = min(step, len(middle) - 1)
        return Stretch(float(middle[step]), float(width[step]))


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
