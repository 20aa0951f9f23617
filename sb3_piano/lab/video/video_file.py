"""Pictures of a video file, by OpenCV."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.video.keyboard import import_cv2
from sb3_piano.viewing.video import Frame

_PICTURES = 31  # for the median, in which hands that move are not seen


@contextlib.contextmanager
def _opened(video: str | os.PathLike[str]) -> Iterator[Any]:
    cv2 = import_cv2()
    reader = cv2.VideoCapture(os.fspath(video)) if os.path.isfile(video) else None
    if reader is None or not reader.isOpened():
        raise ConfigError(f"'{video}' cannot be read as a video: expected a file such as .mp4.")
    try:
        yield reader
    finally:
        reader.release()


def empty_keyboard(video: str | os.PathLike[str]) -> Frame:
    """Return the median of pictures from all of a video, (height, width, 3) RGB.

    Raises:
        ConfigError: If the file is no video or has no pictures.
    """
    cv2 = import_cv2()
    with _opened(video) as reader:
        total = int(reader.get(cv2.CAP_PROP_FRAME_COUNT))
        chosen = set(np.linspace(0, max(total - 1, 0), _PICTURES).astype(int))
        pictures = []
        for k in range(max(chosen) + 1):
            if not reader.grab():
                break
            if k in chosen:
                pictures.append(reader.retrieve()[1][..., ::-1])
    if not pictures:
        raise ConfigError(f"'{video}' has no pictures: expected a video.")
    return np.median(pictures, axis=0).astype(np.uint8)


def pictures_at(video: str | os.PathLike[str], times: Sequence[float]) -> list[Frame]:
    """Return the pictures nearest to growing times, s, (height, width, 3) RGB each.

    Raises:
        ConfigError: If the file is no video or has no pictures.
    """
    cv2 = import_cv2()
    found: list[Frame] = []
    with _opened(video) as reader:
        last = None
        while len(found) < len(times):
            now = reader.get(cv2.CAP_PROP_POS_MSEC) / 1000
            if not reader.grab():
                break
            if now >= times[len(found)] or last is None:
                last = reader.retrieve()[1][..., ::-1]
                while len(found) < len(times) and now >= times[len(found)]:
                    found.append(last)
        if last is None:
            raise ConfigError(f"'{video}' has no pictures: expected a video.")
    return found + [last] * (len(times) - len(found))
