"""Write captions on pictures: the title and the F1 so far."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from PIL import ImageFont

_LEAST_HEIGHT = 160
"""Pictures with fewer rows have no caption, as it would be illegible."""

_INK, _SHADE = (235, 235, 240), (0, 0, 0)


def write_caption(picture: npt.NDArray[np.uint8], title: str, f1: float | None) -> None:
    """Write the title, and the F1 unless it is ``None``, at the top of a picture.

    Args:
        picture: (height, width, 3) uint8, changed in place.
        title: On the left, shortened to half of the width, or omitted if that is too short.
        f1: On the right.
    """
    height, width, _ = picture.shape
    if height < _LEAST_HEIGHT:
        return
    from PIL import Image, ImageDraw  # here, to keep importing environments fast

    size = height // 22
    strip = Image.fromarray(picture[: 2 * size])
    draw, font, edge = ImageDraw.Draw(strip), _font(size), size // 2
    shown = title
    while shown and font.getlength(shown) > width / 2:
        shown = f"{shown[:-2].rstrip()}…" if len(shown) > 1 else ""
    if f1 is not None:
        text = f"F1 so far {f1:.2f}"
        place = (width - edge - font.getlength(text), edge)
        draw.text(place, text, font=font, fill=_INK, stroke_width=1, stroke_fill=_SHADE)
    draw.text((edge, edge), shown, font=font, fill=_INK, stroke_width=1, stroke_fill=_SHADE)
    picture[: 2 * size] = np.asarray(strip)


@functools.lru_cache(maxsize=4)
def _font(size: int) -> ImageFont.FreeTypeFont:
    """Load matplotlib's font, which has the letters of composers' languages."""
    import matplotlib  # here: 0.2 s for a path
    from PIL import ImageFont

    font = Path(matplotlib.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf")
    return ImageFont.truetype(font, size)
