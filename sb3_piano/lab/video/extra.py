"""Packages of the extra ``video-fingering``."""

from __future__ import annotations

import importlib
from typing import Any

from sb3_piano.exceptions import MissingPackageError


def import_extra(name: str) -> Any:
    """Import OpenCV (``cv2``) or librosa.

    Raises:
        MissingPackageError: If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingPackageError(
            f"Fingering from video needs {name}: pip install 'sb3-piano[video-fingering]'"
        ) from error
