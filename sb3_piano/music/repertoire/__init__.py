"""The built-in repertoire: public-domain music with finger labels, each piece a text file."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType

from sb3_piano.music.piece import Piece
from sb3_piano.music.repertoire.header import Header
from sb3_piano.music.repertoire.text import read_header, read_notes

_FOLDER = Path(__file__).parent


def _piece(path: Path) -> Piece:
    header, name = read_header(path), f"repertoire-{path.stem}"
    return Piece(
        name=name,
        title=header.title,
        collection="repertoire",
        source=header.source,
        fingering=header.fingering,
        build=partial(read_notes, path, title=name),
    )


_PIECES = [_piece(path) for path in sorted(_FOLDER.glob("*.notes"))]

REPERTOIRE: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _PIECES})
"""The pieces by name: one for each file ``*.notes`` beside this one."""

__all__ = ["REPERTOIRE", "Header", "read_header", "read_notes"]
