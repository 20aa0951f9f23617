"""Shapes drawn over a hand's links, from ``look.yml`` beside ``hand.yml``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from sb3_piano.hands.spec import HandSpec, Three, read_entries
from sb3_piano.settings import Listed, Nested, Share, settings

_LOOK_FILE = "look.yml"


@settings
class Ball:
    """Ellipsoid in its link's frame."""

    centre: Three
    """m."""
    radii: Three
    """m."""


@settings
class Shape:
    """Convex hull of ellipsoids, drawn over a link."""

    link: str
    """The link with which it moves."""
    color: str
    """Name of one of the look's colours."""
    balls: Annotated[tuple[Nested[Ball], ...], Listed]
    """Ellipsoids of the hull."""


@settings
class Look:
    """Shapes drawn over the links of a right hand."""

    colors: Mapping[str, Annotated[tuple[Share, Share, Share, Share], Listed]]
    """RGBA by name."""
    shapes: Annotated[tuple[Nested[Shape], ...], Listed]
    """Shapes to draw."""


def read_look(hand: HandSpec) -> Look | None:
    """Read the look of a hand, or ``None`` if its own geoms are drawn.

    Raises:
        ConfigError: If the file is damaged.
    """
    file = hand.folder / _LOOK_FILE
    return read_entries(file, Look) if file.is_file() else None
