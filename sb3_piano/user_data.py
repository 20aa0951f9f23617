"""The folder of the user's pieces, known without what reads and writes them."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

DATA_VARIABLE = "SB3_PIANO_DATA"
"""Environment variable with the folder for the user's data, in place of the system's usual one."""

PIECE_SUFFIX = ".npz"
"""Suffix of the file of an imported piece."""


def pieces_folder() -> Path:
    """Return the folder in which imported pieces are kept; it need not exist yet."""
    chosen = os.environ.get(DATA_VARIABLE)
    data = Path(chosen).absolute() if chosen else platformdirs.user_data_path("sb3-piano")
    return data / "pieces"


def piece_names(folder: Path) -> tuple[str, ...]:
    """Return the names of all pieces in a folder, damaged or not, in alphabetical order.

    There are none if the folder is not there, or cannot be read.
    """
    try:
        files = os.listdir(folder)
    except OSError:
        return ()
    return tuple(sorted(f.removesuffix(PIECE_SUFFIX) for f in files if f.endswith(PIECE_SUFFIX)))
