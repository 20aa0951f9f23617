"""File formats of scores, chosen by a file's suffix."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.midi_reading import read_midi
from sb3_piano.music.formats.midi_writing import write_midi
from sb3_piano.music.formats.musicxml.read import read_musicxml
from sb3_piano.music.formats.musicxml.write import write_musicxml
from sb3_piano.music.formats.pig import read_pig, write_pig
from sb3_piano.music.score import Score

T = TypeVar("T")

_MUSICXML = (".musicxml", ".mxl", ".xml")
_HINTS = dict.fromkeys(
    (".mscz", ".mscx", ".sib", ".musx", ".mus", ".dorico", ".gp", ".ly"), " Export it as MusicXML."
)
_HINTS[".zip"] = " A training's model is named by the folder of its run."

READERS: Mapping[str, Callable[[Path], Score]] = MappingProxyType(
    {
        ".mid": read_midi,
        ".midi": read_midi,
        ".txt": read_pig,
        **dict.fromkeys(_MUSICXML, read_musicxml),
    }
)
"""Readers of files, by suffix in lower case."""

WRITERS: Mapping[str, Callable[[Score, Path], None]] = MappingProxyType(
    {
        ".mid": write_midi,
        ".midi": write_midi,
        ".txt": write_pig,
        # The default tempo is the most legible one, for notation programs.
        **dict.fromkeys(_MUSICXML, partial(write_musicxml, tempo=None)),
    }
)
"""Writers of files, by suffix in lower case."""

ACCEPTED_FILES = (
    "a .mid or .midi file (MIDI), a .musicxml, .mxl or .xml file (MusicXML) or a .txt file (PIG "
    "fingering)"
)
"""Readable files, for messages."""


def read_score(path: str | os.PathLike[str], parts: Sequence[str | int] = ()) -> Score:
    """Read a file in the format of its suffix.

    Parts of MusicXML may be chosen by name, or by number from 1.

    Raises:
        ScoreError: If the suffix is unknown, or the file cannot be read as a score.
    """
    path = Path(path)
    read = _of_suffix(READERS, path)
    if not parts:
        return read(path)
    if read is not read_musicxml:
        raise ScoreError(
            f"Parts of {str(path)!r} cannot be chosen: expected MusicXML, or no parts."
        )
    return read_musicxml(path, parts)


def write_score(score: Score, path: str | os.PathLike[str]) -> None:
    """Write a file atomically, in the format of its suffix.

    Raises:
        ScoreError: If the suffix is unknown, or the file cannot be written.
    """
    path = Path(path)
    _of_suffix(WRITERS, path)(score, path)


def _of_suffix(table: Mapping[str, T], path: Path) -> T:
    if path.suffix.lower() not in table:
        hint = _HINTS.get(path.suffix.lower(), "")
        raise ScoreError(
            f"Cannot tell the format of {str(path)!r}: expected {ACCEPTED_FILES}.{hint}"
        )
    return table[path.suffix.lower()]


__all__ = ["read_midi", "read_musicxml", "read_pig", "write_midi", "write_musicxml", "write_pig"]
