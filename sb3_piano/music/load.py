"""The one door through which a piece comes in, whatever the user has."""

from __future__ import annotations

import os
from pathlib import Path

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.catalogue import find_piece
from sb3_piano.music.formats import ACCEPTED_FILES, READERS, read_score
from sb3_piano.music.library import PIECE_SUFFIX, read_piece
from sb3_piano.music.score import Score


def load_score(source: Score | str | os.PathLike[str]) -> Score:
    """Return the score that `source` stands for.

    Args:
        source: A score, which is returned as it is; the name of a piece; or the path of a file,
            which may also be one of the user's library. Text counts as a path if it ends in a known
            suffix or has a separator.

    Raises:
        UnknownPieceError: If the text is neither the name of a piece nor a path.
        ScoreError: If the file cannot be read as a score.
        ConfigError: If `source` is of another type.
    """
    if isinstance(source, Score):
        return source
    if not isinstance(source, str | os.PathLike):
        raise ConfigError(
            f"A piece cannot be given as {type(source).__name__}: expected a Score, the name of "
            f"a piece or the path of {ACCEPTED_FILES}."
        )
    if isinstance(source, str) and not is_path(source):
        return find_piece(source).score()
    path = Path(source)
    return read_piece(path) if path.suffix == PIECE_SUFFIX else read_score(path)


def is_path(text: str) -> bool:
    """Return whether a text is meant as a path: it ends in a known suffix or has a separator."""
    separators = [separator for separator in (os.sep, os.altsep) if separator is not None]
    suffix = Path(text).suffix.lower()
    return suffix in (*READERS, PIECE_SUFFIX) or any(mark in text for mark in separators)
