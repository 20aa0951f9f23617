"""The one door through which a piece comes in, whatever the user has."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError, near_names
from sb3_piano.music.midi import read_midi
from sb3_piano.music.pig import read_pig
from sb3_piano.music.score import Score
from sb3_piano.music.studies import STUDIES, study

READERS: Mapping[str, Callable[[Path], Score]] = MappingProxyType(
    {".mid": read_midi, ".midi": read_midi, ".txt": read_pig}
)
"""How a file is read, by its suffix in lower case."""

_ACCEPTED_FILES = "a .mid or .midi file (MIDI) or a .txt file (PIG fingering)"


def load_score(source: Score | str | os.PathLike[str]) -> Score:
    """Return the score that `source` stands for.

    Args:
        source: A score, which is returned as it is; the name of a study; or the path of a MIDI
            or PIG file. Text counts as a path if it ends in a known suffix or has a separator.

    Raises:
        UnknownPieceError: If the text is neither the name of a study nor a path.
        ScoreError: If the file cannot be read as a score.
        ConfigError: If `source` is of another type.
    """
    if isinstance(source, Score):
        return source
    if not isinstance(source, str | os.PathLike):
        raise ConfigError(
            f"A piece cannot be given as {type(source).__name__}: expected a Score, the name of "
            f"a study or the path of {_ACCEPTED_FILES}."
        )
    if isinstance(source, str) and not _is_path(source):
        return _load_study(source)
    return _load_file(Path(source))


def _is_path(text: str) -> bool:
    separators = [separator for separator in (os.sep, os.altsep) if separator is not None]
    return Path(text).suffix.lower() in READERS or any(mark in text for mark in separators)


def _load_study(name: str) -> Score:
    if name not in STUDIES:
        raise UnknownPieceError(
            f"Unknown piece {name!r}.{near_names(name, STUDIES)} Expected a study "
            f"({', '.join(sorted(STUDIES))}) or the path of {_ACCEPTED_FILES}."
        )
    return study(name)


def _load_file(path: Path) -> Score:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ScoreError(f"Cannot tell the format of {str(path)!r}: expected {_ACCEPTED_FILES}.")
    return reader(path)
