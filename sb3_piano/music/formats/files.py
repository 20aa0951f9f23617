"""Which format a file has, by its suffix."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.midi import read_midi
from sb3_piano.music.formats.pig import read_pig
from sb3_piano.music.score import Score

READERS: Mapping[str, Callable[[Path], Score]] = MappingProxyType(
    {".mid": read_midi, ".midi": read_midi, ".txt": read_pig}
)
"""How a file is read, by its suffix in lower case."""

ACCEPTED_FILES = "a .mid or .midi file (MIDI) or a .txt file (PIG fingering)"
"""The files that can be read, for messages."""


def read_score(path: str | os.PathLike[str]) -> Score:
    """Read a file in the format that its suffix tells.

    Raises:
        ScoreError: If the suffix is unknown, or the file cannot be read as a score.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise ScoreError(f"Cannot tell the format of {str(path)!r}: expected {ACCEPTED_FILES}.")
    return reader(path)
