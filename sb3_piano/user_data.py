"""The folder of the user's pieces; light to import."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

DATA_VARIABLE = "SB3_PIANO_DATA"
"""Environment variable that replaces the system's folder for user data."""

PIECE_SUFFIX = ".npz"
"""Suffix of the file of an imported piece."""


def pieces_folder() -> Path:
    """Return the folder of imported pieces; it need not exist yet."""
    chosen = os.environ.get(DATA_VARIABLE)
    data = Path(chosen).absolute() if chosen else platformdirs.user_data_path("sb3-piano")
    return data / "pieces"


def piece_names(folder: Path) -> tuple[str, ...]:
    """List the names of all pieces in a folder, damaged or not, in alphabetical order.

    The list is empty if the folder is missing or unreadable.
    """
    try:
        files = os.listdir(folder)
    except OSError:
        return ()
    return tuple(sorted(f.removesuffix(PIECE_SUFFIX) for f in files if f.endswith(PIECE_SUFFIX)))
