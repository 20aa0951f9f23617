"""Folders of the user's pieces."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

DATA_VARIABLE = "SB3_PIANO_DATA"
"""Environment variable with the folder for the user's data, in place of the system's usual one."""


def data_folder() -> Path:
    """Return the folder for the user's data; it need not exist yet."""
    chosen = os.environ.get(DATA_VARIABLE)
    return Path(chosen).absolute() if chosen else platformdirs.user_data_path("sb3-piano")


def pieces_folder() -> Path:
    """Return the folder in which imported pieces are kept; it need not exist yet."""
    return data_folder() / "pieces"
