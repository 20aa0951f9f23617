"""Views: cameras for a performance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, MultipleOf

from sb3_piano.engine import mujoco
from sb3_piano.settings import Number, Unit, Whole, settings
from sb3_piano.viewing.note_bars import Stretch
from sb3_piano.viewing.stage import FIELD_OF_VIEW

View = Literal["stage", "close", "top", "roll"]
"""Name of a view."""

LARGEST = (1920, 1080)
"""Largest width and height of a picture, pixels: those of the drawing context."""

PictureWidth = Annotated[Whole, Ge(1), Le(LARGEST[0]), Unit("pixels")]
"""Width of a picture, pixels."""

PictureHeight = Annotated[Whole, Ge(1), Le(LARGEST[1]), Unit("pixels")]
"""Height of a picture, pixels."""

_EVEN = Unit("pixels, even as the video's format demands")


@settings
class Picture:
    """Size and view of a video.

    Raises:
        ConfigError: If a value is out of range.
    """

    width: Annotated[Whole, Ge(2), Le(LARGEST[0]), MultipleOf(2), _EVEN] = 854
    """Pixels, even, at most 1920."""
    height: Annotated[Whole, Ge(2), Le(LARGEST[1]), MultipleOf(2), _EVEN] = 480
    """Pixels, even, at most 1080."""
    view: View = "stage"
    """Name of the view: "stage", "close", "top" or "roll"."""
    fps: Annotated[Number, Gt(0), Le(120), Unit("pictures per second")] = 60.0
    """Pictures per second; those between control steps are interpolated."""


DEFAULT_PICTURE = Picture()
"""A 480p video of the fingers on the keys, with falling notes."""


@dataclass(frozen=True, kw_only=True)
class Shot:
    """A camera that shows a part of the keyboard."""

    azimuth: float
    """Direction of view, degrees: 180 is from the player to the keys."""
    elevation: float
    """Elevation of view, degrees; below 0 is down, below -90 from above the piano to the player."""
    x: float
    z: float
    """Target point, m: across the keys, and the height."""
    margin: float
    """Visible width beside the keys, m."""
    height: float
    """Least visible height, m."""
    follows: bool = False
    """Whether it follows the music; otherwise it shows all keys of the piece."""
    foot: float | None = None
    """Distance of the target from the lower edge, m, so that notes have the room above the keys;
    ``None`` for a target in the middle, without notes."""


SHOTS: Mapping[View, Shot] = {
    "stage": Shot(azimuth=180, elevation=-138, x=0.0, z=0.03, margin=0.16, height=0.38, foot=0.2),
    "close": Shot(
        azimuth=140, elevation=-30, x=0.04, z=0.05, margin=0.14, height=0.22, follows=True
    ),
    "top": Shot(azimuth=180, elevation=-90, x=0.05, z=0.0, margin=0.25, height=0.3),
    "roll": Shot(azimuth=180, elevation=-138, x=0.0, z=0.03, margin=0.3, height=0.6, foot=0.17),
}
"""The cameras of pictures, by view."""

WINDOW_SHOTS: Mapping[View, Shot] = {
    **SHOTS,
    "stage": Shot(azimuth=180, elevation=-36, x=0.0, z=0.165, margin=0.3, height=0.42),
    "roll": Shot(azimuth=180, elevation=-20, x=0.0, z=0.25, margin=0.36, height=0.52),
}
"""The first cameras of a window, in which notes fall in front of the panel."""


def place_camera(camera: mujoco.MjvCamera, shot: Shot, stretch: Stretch, aspect: float) -> None:
    """Move a free camera so that it shows a part of the keyboard.

    Args:
        camera: A camera for the stage.
        shot: Where it stands.
        stretch: The part of the keyboard to show.
        aspect: Width of the picture by its height.
    """
    height = max((stretch.width + shot.margin) / aspect, shot.height)
    tilt = math.radians(shot.elevation)
    up = 0.0 if shot.foot is None else height / 2 - shot.foot
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.azimuth, camera.elevation = shot.azimuth, shot.elevation
    target = shot.x + up * math.sin(tilt), stretch.middle, shot.z + up * math.cos(tilt)
    camera.lookat[:] = target
    camera.distance = height / (2 * math.tan(math.radians(FIELD_OF_VIEW / 2)))
