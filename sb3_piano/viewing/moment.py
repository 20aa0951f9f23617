"""A moment of a performance, and its colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.simulation import PianoScene

Color = tuple[float, float, float, float]
"""RGBA, each from 0 to 1."""

# Okabe and Ito's palette for colour-blind people, without its greens: green means that a key
# sounds.
_THUMB_TO_LITTLE = (
    (0.84, 0.37, 0.00, 1.0),  # vermillion
    (0.00, 0.45, 0.70, 1.0),  # blue
    (0.94, 0.89, 0.26, 1.0),  # yellow
    (0.80, 0.47, 0.65, 1.0),  # reddish purple
    (0.34, 0.71, 0.91, 1.0),  # sky blue
)

FINGER_COLORS = _THUMB_TO_LITTLE * 2
"""RGBA of each finger label 0-9: the same for both hands, thumb to little finger."""

UNLABELLED_COLOR = (0.55, 0.55, 0.62, 1.0)
"""RGBA of a due key without a finger label."""

PRESSED_COLOR = (0.13, 0.72, 0.25, 1.0)
"""RGBA of a key that sounds rightly, and of its note."""

WRONG_COLOR = (0.80, 0.03, 0.10, 1.0)
"""RGBA of a key that sounds wrongly."""

MISSED_COLOR = (0.30, 0.30, 0.33, 1.0)
"""RGBA of a due note whose key is silent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """State of the scene at one time, for a picture."""

    qpos: FloatArray
    """(nq,) joint positions, rad or m."""
    step: float
    """Finished control steps; between two of them it has a fraction."""
    due: npt.NDArray[np.intp]
    """(n,) due keys."""
    fingers: npt.NDArray[np.int8]
    """(n,) finger label of each due key, -1 where unknown."""
    sounding: BoolArray | None
    """(88,) keys that sound; ``None`` to draw right and wrong keys alike."""
    f1: float | None = None
    """F1 of the steps so far; ``None`` to show no number."""
    pedal: bool = False
    """Whether the sustain pedal is down."""


def finger_color(finger: int) -> Color:
    """Return the RGBA of a finger label, also of -1, unknown."""
    return FINGER_COLORS[finger] if finger >= 0 else UNLABELLED_COLOR


def geom_colors(
    scene: PianoScene,
    *,
    due: npt.NDArray[np.intp],
    fingers: npt.NDArray[np.integer[Any]],
    sounding: BoolArray | None,
) -> dict[int, Color]:
    """Return the RGBA of fingertips, due keys and sounding keys by geom id.

    See :class:`Moment` for the arguments.
    """
    tips = zip(scene.fingertip_geom.tolist(), scene.fingers.tolist(), strict=True)
    colors = {geom: finger_color(finger) for geom, finger in tips}
    key_geom = scene.key_geom.tolist()
    asked = set(due.tolist())
    for key, finger in zip(due.tolist(), fingers.tolist(), strict=True):
        colors[key_geom[key]] = finger_color(finger)
    for key in [] if sounding is None else np.flatnonzero(sounding).tolist():
        colors[key_geom[key]] = PRESSED_COLOR if key in asked else WRONG_COLOR
    return colors
