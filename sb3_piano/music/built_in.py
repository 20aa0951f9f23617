"""The built-in pieces: generated studies, and MIDI files with a table of facts."""

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
from sb3_piano.music.studies import STUDIES


def _collection(name: str) -> Mapping[str, Piece]:
    """Load the pieces of the folder of that name beside this file, by name.

    Each entry of ``pieces.yml`` is a piece, with a MIDI file of that name beside it.
    """
    folder = Path(__file__).with_name(name)
    pieces = (
        _piece(folder, stem, facts) for stem, facts in read_table(folder / "pieces.yml").items()
    )
    return MappingProxyType({piece.name: piece for piece in pieces})


def _piece(folder: Path, stem: str, facts: Mapping[str, Any]) -> Piece:
    name = f"{folder.name}-{stem}"
    return Piece(
        name=name,
        title=facts["title"],
        collection=folder.name,
        source=facts["source"],
        fingering=facts.get("fingering", "none"),
        composer=facts["composer"],
        build=partial(_read, folder / f"{stem}.mid", name, facts.get("upbeat", False)),
    )


def _read(path: Path, name: str, has_upbeat: bool) -> Score:
    score = read_midi(path)
    # MIDI begins a bar at 0 s even if the music begins in the middle of one.
    return replace(score, title=name, bars=score.bars[1:] if has_upbeat else score.bars)


REPERTOIRE = _collection("repertoire")
"""Public-domain music with finger labels, by name."""

ENCORE = _collection("encore")
"""Held-out public-domain pieces, never used to tune anything, by name."""

BUILT_IN: Mapping[str, Piece] = MappingProxyType({**STUDIES, **REPERTOIRE, **ENCORE})
"""All built-in pieces by name."""
