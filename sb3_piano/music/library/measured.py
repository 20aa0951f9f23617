"""The features of difficulty of pieces, of which imported ones remember theirs."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from sb3_piano.music.difficulty import Features, features
from sb3_piano.music.library.imported import user_library
from sb3_piano.music.library.piece_file import PieceInfo
from sb3_piano.music.piece import Piece


def piece_features(piece: Piece) -> Features:
    """Return a piece's features; those of an imported one were noted in its file, if possible.

    Raises:
        ScoreError: If its score cannot be made, or no two hands can play it.
    """
    library = user_library()
    if piece.name in library:
        noted = _noted(library.info(piece.name))
        if noted is not None:
            return noted
    return features(piece.score())


def _noted(info: PieceInfo) -> Features | None:
    """Return the features in a file, unless there are none or another version named others."""
    if info.features is None or set(info.features) != {field.name for field in fields(Features)}:
        return None
    # JSON has no tuples.
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in info.features.items()
    }
    return Features(**values)
