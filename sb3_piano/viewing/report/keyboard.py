"""The keyboard on the vertical axis of the piano roll."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.music import MIN_PITCH, NUM_KEYS
from sb3_piano.viewing.report.theme import RULE, SHADE

_PITCH_CLASSES = ("C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B")
_MIDDLE_C = 39
_LEAST_RANGE = 12
_MARGIN = 2


def note_name(key: int) -> str:
    """Return the name of a key.

    >>> note_name(39), note_name(40)
    ('C4', 'C♯4')

    Args:
        key: 0-87.
    """
    octave, pitch_class = divmod(MIN_PITCH + key, 12)
    return f"{_PITCH_CLASSES[pitch_class]}{octave - 1}"


def key_range(keys: npt.NDArray[np.intp]) -> tuple[int, int]:
    """Return the lowest and the highest key to show: all these, and an octave at least."""
    if len(keys) == 0:
        keys = np.array([_MIDDLE_C])
    low, high = int(keys.min()) - _MARGIN, int(keys.max()) + _MARGIN
    missing = max(0, _LEAST_RANGE - (high - low))
    low, high = low - missing // 2, high + (missing + 1) // 2
    return max(low, 0), min(high, NUM_KEYS - 1)


def key_labels(low: int, high: int, *, all_white: bool) -> dict[str, Any]:
    """Return the ticks of an axis of keys.

    Args:
        low: The lowest key.
        high: The highest one.
        all_white: Whether to name all white keys; otherwise the Cs alone.
    """
    keys = [key for key in range(low, high + 1) if not _is_black(key)]
    if not all_white:
        keys = [key for key in keys if _is_c(key)]
    return {"tickvals": keys, "ticktext": [note_name(key) for key in keys]}


def keyboard_shapes() -> list[dict[str, Any]]:
    """Return shades for the rows of the black keys, and a line below each C."""
    across = {"xref": "paper", "x0": 0, "x1": 1, "yref": "y", "layer": "below"}
    shade = {**across, "type": "rect", "fillcolor": SHADE, "line": {"width": 0}}
    line = {**across, "type": "line", "line": {"color": RULE, "width": 1}}
    return [
        {**(shade if _is_black(key) else line), "y0": key - 0.5, "y1": bottom}
        for key in range(NUM_KEYS)
        for bottom in [key + 0.5 if _is_black(key) else key - 0.5]
        if _is_black(key) or _is_c(key)
    ]


def _is_black(key: int) -> bool:
    return "♯" in note_name(key)


def _is_c(key: int) -> bool:
    return (MIN_PITCH + key) % 12 == 0
