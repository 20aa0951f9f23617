"""Find pieces by name, and load scores from names, files or fields."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, UnknownPieceError, near_names
from sb3_piano.music.built_in import BUILT_IN
from sb3_piano.music.formats import ACCEPTED_FILES, READERS, read_score
from sb3_piano.music.library import imported_pieces
from sb3_piano.music.library.datasets import PIG_PIECES
from sb3_piano.music.library.piece_file import read_piece
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.user_data import PIECE_SUFFIX

ScoreSource = Score | str | os.PathLike[str]
"""Sources that :func:`load_score` accepts, besides a mapping of fields."""


def pieces() -> Mapping[str, Piece]:
    """Return all pieces by name: the built-in ones, then the user's imported ones."""
    return {**BUILT_IN, **imported_pieces()}


def of_collection(known: Mapping[str, Piece], collection: str) -> list[str]:
    """List the names of the pieces of a collection.

    ``"imported"`` has all imported pieces, also those in another collection.
    """
    own = imported_pieces() if collection == "imported" else {}
    return [name for name, piece in known.items() if piece.collection == collection or name in own]


def shown_title(title: str) -> str:
    """Return the readable title of a score, "Für Elise" for "repertoire-FurElise".

    The title of a built-in piece's score is the piece's name; other titles are returned unchanged.
    """
    return BUILT_IN[title].title if title in BUILT_IN else title


def find_piece(name: str) -> Piece:
    """Find a piece by its name, with or without the collection: ``"FurElise"``.

    Built-in pieces take precedence over others with the same short name. The pieces of the PIG data
    set are found before their import; making their score explains how to get it.

    Raises:
        UnknownPieceError: If no piece has this name, or several collections have one.
    """
    known = {**PIG_PIECES, **pieces()}
    if name in known:
        return known[name]
    matches = _named_in_short(name, BUILT_IN) or _named_in_short(name, known)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise UnknownPieceError(
            f"Piece {name!r} is in several collections: expected one of "
            f"{', '.join(repr(piece.name) for piece in matches)}."
        )
    short = (full.removeprefix(f"{piece.collection}-") for full, piece in known.items())
    raise UnknownPieceError(
        f"Unknown piece {name!r}.{near_names(name, [*known, *short])} Expected a name from "
        "'sb3-piano pieces list' or the path of a file."
    )


def _named_in_short(name: str, known: Mapping[str, Piece]) -> list[Piece]:
    return [piece for full, piece in known.items() if full == f"{piece.collection}-{name}"]


def load_score(source: ScoreSource | Mapping[str, Any], parts: Sequence[str | int] = ()) -> Score:
    """Load the score of a source.

    Args:
        source: A score, returned unchanged; its fields by name, as gymnasium writes them into the
            JSON of an environment's spec; the name of a piece; or the path of a file, also of the
            user's library. Text counts as a path if it ends in a known suffix or has a separator,
            or is an existing file's name with a suffix.
        parts: The parts of a MusicXML file to read, by name or by number from 1; by default the
            piano's.

    Raises:
        UnknownPieceError: If the text is neither the name of a piece nor a path.
        ScoreError: If the file cannot be read as a score.
        ConfigError: If `source` is of another type, or parts are given without a file.
    """
    is_file = is_path(source) if isinstance(source, str) else isinstance(source, os.PathLike)
    if parts and not is_file:
        raise ConfigError("Parts can be chosen only in a file: expected a MusicXML file.")
    if isinstance(source, Score):
        return source
    if isinstance(source, Mapping):
        return Score.from_fields(source)
    if not isinstance(source, str | os.PathLike):
        raise ConfigError(
            f"A piece cannot be given as {type(source).__name__}: expected a Score, the name of "
            f"a piece or the path of {ACCEPTED_FILES}."
        )
    if isinstance(source, str) and not is_file:
        return find_piece(source).score()
    path = Path(source)
    return read_piece(path) if path.suffix == PIECE_SUFFIX else read_score(path, parts)


def is_path(text: str) -> bool:
    """Return whether text is meant as a path.

    It ends in a known suffix, has a separator, or is an existing file's name with a suffix.
    """
    separators = [separator for separator in (os.sep, os.altsep) if separator is not None]
    suffix = Path(text).suffix.lower()
    is_known = suffix in (*READERS, PIECE_SUFFIX) or any(mark in text for mark in separators)
    return is_known or (suffix != "" and os.path.isfile(text))
