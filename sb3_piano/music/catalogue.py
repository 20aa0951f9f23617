"""All pieces that have a name: those that come with the package, and the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from sb3_piano.exceptions import UnknownPieceError, near_names
from sb3_piano.music.library import PIG_PIECES, imported_pieces
from sb3_piano.music.piece import Piece
from sb3_piano.music.repertoire import REPERTOIRE
from sb3_piano.music.studies import STUDIES

BUILT_IN: Mapping[str, Piece] = MappingProxyType({**STUDIES, **REPERTOIRE})
"""The pieces that come with the package, by name."""


def pieces() -> Mapping[str, Piece]:
    """Return all pieces by name: the built-in ones, then what the user has imported."""
    return {**BUILT_IN, **imported_pieces()}


def find_piece(name: str) -> Piece:
    """Return the piece of a name, which may lack the collection: ``"FurElise"``.

    Of pieces with the same short name, those that come with the package go first. The pieces of
    the PIG data set are found before it is imported, too; making one says how to get it.

    Raises:
        UnknownPieceError: If there is no such piece, or several collections have one.
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
