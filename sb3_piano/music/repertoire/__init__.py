"""The built-in repertoire: public-domain music with finger labels, each piece a MIDI file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

from sb3_piano.files import read_table
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score

_FOLDER = Path(__file__).parent


def _read(path: Path, name: str, has_upbeat: bool) -> Score:
    score = read_midi(path)
    # MIDI begins a bar at 0 s even where the music begins in the middle of one.
    return replace(score, title=name, bars=score.bars[1:] if has_upbeat else score.bars)


def _piece(stem: str, facts: Mapping[str, Any]) -> Piece:
    name, path = f"repertoire-{stem}", _FOLDER / f"{stem}.mid"
    return Piece(
        name=name,
        title=facts["title"],
        collection="repertoire",
        source=facts["source"],
        fingering=facts["fingering"],
        composer=facts["composer"],
        build=partial(_read, path, name, facts.get("upbeat", False)),
    )


_PIECES = [_piece(stem, facts) for stem, facts in read_table(_FOLDER / "pieces.yml").items()]

REPERTOIRE: Mapping[str, Piece] = MappingProxyType({piece.name: piece for piece in _PIECES})
"""The pieces by name: one for each entry of ``pieces.yml`` and each MIDI file beside it."""

__all__ = ["REPERTOIRE"]
