"""What is drawn over a hand's links, as ``look.yml`` beside ``hand.yml`` says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from sb3_piano.hands.spec import HandSpec, Three, read_entries
from sb3_piano.settings import Listed, Nested, Share, settings

_LOOK_FILE = "look.yml"


@settings
class Ball:
    """An ellipsoid in its link's frame."""

    centre: Three
    """m."""
    radii: Three
    """m."""


@settings
class Shape:
    """The hull of ellipsoids, over a link."""

    link: str
    """The link with which it moves."""
    color: str
    """One of the look's colours."""
    balls: Annotated[tuple[Nested[Ball], ...], Listed]
    """What it is the hull of."""


@settings
class Look:
    """What is drawn over the links of a right hand."""

    colors: Mapping[str, Annotated[tuple[Share, Share, Share, Share], Listed]]
    """RGBA by name."""
    shapes: Annotated[tuple[Nested[Shape], ...], Listed]
    """What is drawn."""


def read_look(hand: HandSpec) -> Look | None:
    """Return what is drawn over a hand, or None, where its own shapes are.

    Raises:
        ConfigError: If the file is damaged.
    """
    file = hand.folder / _LOOK_FILE
    return read_entries(file, Look) if file.is_file() else None
