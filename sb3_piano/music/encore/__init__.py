"""Further public-domain pieces, each an ABC file, which had no say in how anything was tuned."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import MappingProxyType

from sb3_piano.music.encore.abc_reading import read_abc, read_header
from sb3_piano.music.piece import Piece


def _piece(path: Path) -> Piece:
    name, header = f"encore-{path.stem}", read_header(path)
    return Piece(
        name=name,
        title=header["T"],
        collection="encore",
        source=header["S"],
        fingering="none",
        composer=header["C"],
        build=partial(read_abc, path, name),
    )


_PIECES = [_piece(path) for path in sorted(Path(__file__).parent.glob("*.abc"))]

ENCORE: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _PIECES})
"""The pieces by name, one for each file."""

__all__ = ["ENCORE"]
