"""The user's library: pieces that were imported, kept in a folder of the user's."""

from collections.abc import Mapping

from sb3_piano.music.piece import Piece


def imported_pieces() -> Mapping[str, Piece]:
    """Return the imported pieces by name."""
    return {}


__all__ = ["imported_pieces"]
