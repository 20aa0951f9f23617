"""Write captions on pictures: the title, the F1 so far, and a legend with the pedal's lamp."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.viewing.moment import (
    FINGER_COLORS,
    MISSED_COLOR,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    WRONG_COLOR,
    Color,
)

_LEAST_HEIGHT = 160
"""Pictures with fewer rows have no caption, as it would be illegible."""
_LEAST_WIDTH = 560
"""Pictures with fewer columns have no legend."""

_INK, _SHADE = (235, 235, 240), (0, 0, 0)
_LAMP = (1.0, 0.72, 0.1, 1.0)
"""RGBA of the lamp while the pedal is down."""

# Name, RGBA, and that of the rim, of each mark.
_FINGERS = ("thumb", "index", "middle", "ring", "little")
_MARKS: tuple[tuple[str, Color, Color | None], ...] = (
    *((name, FINGER_COLORS[finger], None) for finger, name in enumerate(_FINGERS)),
    ("right key", UNLABELLED_COLOR, PRESSED_COLOR),
    ("wrong key", WRONG_COLOR, None),
    ("missed", MISSED_COLOR, None),
)


class _Patch(NamedTuple):
    """A small picture with transparent parts."""

    ink: Any
    """(height, width, 3) uint16 colours, times their opacity and 256."""
    rest: Any
    """(height, width, 1) uint16 transparency, times 256."""

    def put(self, picture: npt.NDArray[np.uint8], left: int, top: int) -> None:
        height, width, _ = self.ink.shape
        part: npt.NDArray[Any] = picture[top : top + height, left : left + width]
        height, width, _ = part.shape
        part[:] = (part * self.rest[:height, :width] + self.ink[:height, :width]) >> 8


def write_caption(
    picture: npt.NDArray[np.uint8], title: str, f1: float | None, pedal: bool | None = None
) -> None:
    """Write the title, and the F1 unless it is ``None``, at the top of a picture.

    Args:
        picture: (height, width, 3) uint8, changed in place.
        title: On the left, shortened to half of the width, or omitted if that is too short.
        f1: On the right.
        pedal: Whether the pedal is down; with it there is a legend at the foot of the picture.
    """
    height, width, _ = picture.shape
    if height < _LEAST_HEIGHT:
        return
    size = height // 22
    if shown := _shortened(title, size, width // 2):
        _text(shown, size).put(picture, size // 2, size // 2)
    if f1 is not None:
        patch = _text(f"F1 so far {f1:.2f}", size)
        patch.put(picture, width - size // 2 - patch.ink.shape[1], size // 2)
    if pedal is not None and (rows := legend_height(width, height)):
        picture[-rows:] = _legend(width, rows // 2, pedal)


def legend_height(width: int, height: int) -> int:
    """Return the number of rows of the legend, which hides what is under it; 0 without one."""
    if height < _LEAST_HEIGHT or width < _LEAST_WIDTH:
        return 0
    return 2 * min(width // 60, height // 22)


@functools.lru_cache(maxsize=8)
def _shortened(text: str, size: int, width: int) -> str:
    while text and _font(size).getlength(text) > width:
        text = f"{text[:-2].rstrip()}…" if len(text) > 1 else ""
    return text


@functools.lru_cache(maxsize=256)
def _text(text: str, size: int) -> _Patch:
    from PIL import Image, ImageDraw  # here, to keep importing environments fast

    font = _font(size)
    image = Image.new("RGBA", (round(font.getlength(text)) + 2, round(1.4 * size)))
    ImageDraw.Draw(image).text(
        (1, 0), text, font=font, fill=_INK, stroke_width=1, stroke_fill=_SHADE
    )
    return _patch(image)


@functools.lru_cache(maxsize=8)
def _legend(width: int, size: int, pedal: bool) -> npt.NDArray[np.uint8]:
    """Draw the marks, and the lamp of the pedal at the right end."""
    from PIL import Image, ImageDraw

    font, edge = _font(size), size // 2
    image = Image.new("RGB", (width, 2 * size), (6, 6, 8))
    draw, left = ImageDraw.Draw(image), float(size)

    def mark(name: str, color: Color, rim: Color | None, shape: Any, left: float) -> float:
        fill, outline = (
            tuple(round(255 * part) for part in each[:3]) for each in (color, rim or color)
        )
        box = (left, edge, left + size, edge + size)
        shape(box, fill=fill, outline=outline, width=max(size // 5, 1))
        draw.text((left + 1.4 * size, edge - size // 8), name, font=font, fill=_INK)
        return left + 2.4 * size + font.getlength(name)

    for each in _MARKS:
        left = mark(*each, draw.rectangle, left)
    place = width - 2.4 * size - font.getlength("pedal")
    mark("pedal", _LAMP if pedal else (0.0, 0.0, 0.0, 1.0), MISSED_COLOR, draw.ellipse, place)
    return np.asarray(image)


def _patch(image: Any) -> _Patch:
    pixels = np.asarray(image, dtype=np.float32)
    opacity = (pixels[..., 3:] * (256 / 255)).round()
    return _Patch((pixels[..., :3] * opacity).astype(np.uint16), (256 - opacity).astype(np.uint16))


@functools.lru_cache(maxsize=4)
def _font(size: int) -> Any:
    """Load matplotlib's font, which has the letters of composers' languages, or Pillow's."""
    from PIL import ImageFont

    try:
        import matplotlib  # here: 0.2 s for a path
    except ImportError:  # where only players are installed
        return ImageFont.load_default(size)
    font = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(font, size)
