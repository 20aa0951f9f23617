"""Which shapes of the scene have which colour at a moment of the music."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.simulation import PianoScene
from sb3_piano.viewing.colors import FINGER_COLORS, PRESSED_COLOR, UNLABELLED_COLOR

Color = tuple[float, float, float, float]


def geom_colors(
    scene: PianoScene,
    *,
    due: npt.NDArray[np.intp],
    fingers: npt.NDArray[np.integer[Any]],
    sounding: npt.NDArray[np.bool_],
) -> dict[int, Color]:
    """Return the RGBA of fingertips, due keys and sounding keys by the id of their geom.

    Args:
        scene: Whose geoms they are.
        due: (n,) keys that should be down.
        fingers: (n,) finger label of each of them, -1 where unknown.
        sounding: (88,) bool, keys that sound.
    """
    colors = dict(zip(scene.fingertip_geom.tolist(), FINGER_COLORS, strict=True))
    for key, finger in zip(due, fingers, strict=True):
        color = FINGER_COLORS[finger] if finger >= 0 else UNLABELLED_COLOR
        colors[int(scene.key_geom[key])] = color
    for key in np.flatnonzero(sounding):
        colors[int(scene.key_geom[key])] = PRESSED_COLOR
    return colors
