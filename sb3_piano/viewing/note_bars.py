"""Falling notes: bars above the keys that come down onto them as they fall due."""

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
"""What a bar is shortened by at each end, m, so that repeated notes are apart."""

_PAST, _COMING = 1.0, 2.0
"""What a view that follows the music has in sight of it, s before and after now."""
_LEAST_STRETCH, _LEAST_FOLLOWED = 0.5, 0.25
"""Least width of the keys in sight, m, of the whole piece and of a view that follows."""


class Bar(NamedTuple):
    """A box in the scene."""

    centre: tuple[float, float, float]
    """Its place, m."""
    half: tuple[float, float, float]
    """Half of its edges, m."""
    color: Color
    """Its RGBA."""


class Stretch(NamedTuple):
    """A part of the keyboard."""

    middle: float
    """Place along the keyboard, m."""
    width: float
    """Distance of its ends, m."""


@dataclass(frozen=True, eq=False)
class NoteBars:
    """The notes of a roll over the keys of a scene."""

    roll: PianoRoll
    """What should be played."""
    notes: Presses
    """The runs of steps in which keys are due."""
    key_y: FloatArray
    """(88,) places of the keys along the keyboard, m."""
    whole: Stretch
    """Keys of the piece."""
    near: tuple[FloatArray, FloatArray]
    """Middles and widths, (t + 1,) m each, of what is due around each control step."""

    @classmethod
    def over(cls, scene: PianoScene, roll: PianoRoll) -> NoteBars:
        """Lay the notes of a roll over the keys of a scene."""
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
        """Return the bars after so many control steps.

        Once the first step of a note is over, its bar tells whether its key is among the (88,) that
        sound, unless these are ``None``.
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
        """Return what is due around the time after so many control steps."""
        middle, width = self.near
        step = min(step, len(middle) - 1)
        return Stretch(float(middle[step]), float(width[step]))


def _stretch(low: float, high: float, least: float) -> Stretch:
    return Stretch((low + high) / 2, max(high - low, least))


def _near(roll: PianoRoll, key_y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles and the widths of what is due around each time, moving smoothly."""
    # Here, as environments import this, too, and it takes 0.3 s.
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d, minimum_filter1d

    due = roll.active.any(axis=1)
    steps = np.arange(len(roll) + 1)
    if not due.any():
        whole = _stretch(key_y[0], key_y[-1], _LEAST_FOLLOWED)
        return np.full(len(steps), whole.middle), np.full(len(steps), whole.width)
    lowest, highest = roll.active.argmax(axis=1), roll.active[:, ::-1].argmax(axis=1)
    window = round((_PAST + _COMING) / roll.control_timestep)
    # A filter looks as far back as ahead, unless it is moved.
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
