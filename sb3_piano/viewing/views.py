"""Views: cameras for a performance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le, MultipleOf

from sb3_piano.engine import mujoco
from sb3_piano.settings import Unit, Whole, settings
from sb3_piano.viewing.note_bars import Stretch
from sb3_piano.viewing.stage import FIELD_OF_VIEW

View = Literal["stage", "close", "top", "roll"]
"""Name of a view."""

_EVEN = Unit("pixels, even as the video's format demands")


@settings
class Picture:
    """Size and view of a video.

    Raises:
        ConfigError: If a value is out of range.
    """

    width: Annotated[Whole, Ge(2), Le(1920), MultipleOf(2), _EVEN] = 854
    """Pixels, even, at most 1920."""
    height: Annotated[Whole, Ge(2), Le(1080), MultipleOf(2), _EVEN] = 480
    """Pixels, even, at most 1080."""
    view: View = "stage"
    """Name of the view: "stage", "close", "top" or "roll"."""


DEFAULT_PICTURE = Picture()
"""A 480p video from over the pianist's shoulders."""


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A camera that shows a part of the keyboard."""

    azimuth: float
    """Direction of view, degrees: 180 is from the player to the keys."""
    elevation: float
    """Elevation of view, degrees; below 0 is down."""
    x: float
    z: float
    """Target point, m: across the keys, and the height."""
    margin: float
    """Visible width beside the keys, m."""
    height: float
    """Least visible height, m."""
    follows: bool = False
    """Whether it follows the music; otherwise it shows all keys of the piece."""
    bars: bool = True
    """Whether it shows falling notes."""


SHOTS: Mapping[View, Shot] = {
    "stage": Shot(azimuth=180, elevation=-36, x=0.0, z=0.165, margin=0.3, height=0.42),
    "close": Shot(
        azimuth=140,
        elevation=-30,
        x=0.04,
        z=0.05,
        margin=0.14,
        height=0.22,
        follows=True,
        bars=False,
    ),
    "top": Shot(azimuth=180, elevation=-90, x=0.05, z=0.0, margin=0.25, height=0.3, bars=False),
    "roll": Shot(azimuth=180, elevation=-20, x=0.0, z=0.25, margin=0.36, height=0.52),
}
"""The cameras, by view."""


def place_camera(camera: mujoco.MjvCamera, view: View, stretch: Stretch, aspect: float) -> None:
    """Move a free camera so that a view shows a part of the keyboard.

    Args:
        camera: A camera for the stage.
        view: The view.
        stretch: The part of the keyboard to show.
        aspect: Width of the picture by its height.
    """
    shot = SHOTS[view]
    height = max((stretch.width + shot.margin) / aspect, shot.height)
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = shot.azimuth, shot.elevation
    camera.lookat[:] = shot.x, stretch.middle, shot.z
    camera.distance = height / (2 * math.tan(math.radians(FIELD_OF_VIEW / 2)))
