"""The pieces in the user's own library, for everything that knows pieces by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from sb3_piano.music.library.folder import pieces_folder
from sb3_piano.music.library.store import Library
from sb3_piano.music.piece import Piece

_libraries: dict[Path, Library] = {}
"""Libraries read in this process, by folder."""


def user_library() -> Library:
    """Return the user's library, which remembers what it has read."""
    folder = pieces_folder()
    return _libraries.setdefault(folder, Library(folder))


def imported_pieces() -> Mapping[str, Piece]:
    """Return the imported pieces by name; none if their folder cannot be read."""
    try:
        return user_library().pieces()
    except OSError:
        return {}
