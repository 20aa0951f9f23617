"""Parts of several formats: notes that are left out, packed files, writing."""

from __future__ import annotations

import contextlib
import os
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sb3_piano.exceptions import ScoreError, ScoreWarning, one_line
from sb3_piano.files import write_bytes
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.pitch import pitch_name

_MOST_NAMED = 3


@dataclass
class LeftOut:
    """The notes that were left out while a file was read.

    Attributes:
        empty: Notes that end when they start: (time in s, MIDI pitch).
        outside: Notes off the keyboard, likewise.
    """

    empty: list[tuple[float, int]] = field(default_factory=list)
    outside: list[tuple[float, int]] = field(default_factory=list)

    def is_playable(self, onset: float, offset: float, pitch: int) -> bool:
        """Return whether a piano has the key and the note a length; take note of it if not."""
        if not MIN_PITCH <= pitch <= MAX_PITCH:
            self.outside.append((onset, pitch))
        elif not offset > onset:
            self.empty.append((onset, pitch))
        else:
            return True
        return False

    def __str__(self) -> str:
        """Return ``"2 notes without length (D4 at 1 s, E4 at 2 s)"``, empty if there are none."""
        parts = []
        if self.empty:
            parts.append(f"{_notes(self.empty)} without length ({_first(self.empty)})")
        if self.outside:
            parts.append(f"{_notes(self.outside)} off the keyboard ({_first(self.outside)})")
        return " and ".join(parts)

    def warn(self, path: Path) -> None:
        """Warn the caller of a reader, which calls this, of what was left out, if anything."""
        if self.empty or self.outside:
            warnings.warn(f"Reading {str(path)!r} left out {self}.", ScoreWarning, stacklevel=3)


def _notes(events: Sequence[tuple[float, int]]) -> str:
    return "1 note" if len(events) == 1 else f"{len(events)} notes"


def _first(events: Sequence[tuple[float, int]]) -> str:
    named = [f"{pitch_name(pitch)} at {time:g} s" for time, pitch in sorted(events)[:_MOST_NAMED]]
    return ", ".join(named) + (", ..." if len(events) > _MOST_NAMED else "")


@contextlib.contextmanager
def reading(path: Path, kind: str, expected: str) -> Iterator[None]:
    """Say of a file that cannot be read which one it is, and why.

    Args:
        path: The file.
        kind: What it should be: ``"MIDI file"``.
        expected: The end of the message.

    Raises:
        ScoreError: If there is no such file, or anything is raised meanwhile.
    """
    if not os.path.isfile(path):  # which also answers for a name that no file can have
        raise ScoreError(f"There is no {kind} {str(path)!r}: expected an existing file.")
    try:
        yield
    except ScoreError:
        raise
    except Exception as error:
        # A damaged file surfaces as whatever the parsers happen to stumble over.
        raise ScoreError(
            f"Cannot read {str(path)!r} as a {kind} ({one_line(error)}): expected {expected}."
        ) from error


def write_score_file(path: Path, content: bytes) -> None:
    """Write the bytes of a score, whole or not at all.

    Raises:
        ScoreError: If the file cannot be written.
    """
    try:
        write_bytes(path, content)
    except OSError as error:
        raise ScoreError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error


def read_member(archive: zipfile.ZipFile, name: str, most: int) -> bytes:
    """Return a file of an archive, of which no more is unpacked than may be.

    Args:
        archive: The archive.
        name: The file's name in it.
        most: The largest size that the file may have, bytes.

    Raises:
        ValueError: If the file is larger.
        Exception: Whatever zipfile raises at a damaged or missing one.
    """
    with archive.open(name) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"its {name} holds more than {most} bytes")
    return content
