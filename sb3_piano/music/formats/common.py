"""Shared code of the formats: left-out notes, choice of parts, writing."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.files import write_bytes
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.text_file import read_whole

_MOST_NAMED = 3


class LeftOut:
    """Collects the notes left out while a file is read."""

    def __init__(self) -> None:
        self._notes: dict[str, list[tuple[float, int]]] = defaultdict(list)

    def add_empty(self, time: float, pitch: int) -> None:
        """Record a note without length, at a time in s."""
        self._notes["without length"].append((time, pitch))

    def is_playable(self, onset: float, offset: float, pitch: int) -> bool:
        """Return whether a note is on the keyboard and has a length; record it if not."""
        if not MIN_PITCH <= pitch <= MAX_PITCH:
            self._notes["off the keyboard"].append((onset, pitch))
        elif not offset > onset:
            self.add_empty(onset, pitch)
        else:
            return True
        return False

    def warn(self, path: Path) -> None:
        """Warn the caller of a reader about left-out notes, if there are any."""
        if self._notes:
            warnings.warn(f"Reading {str(path)!r} left out {self}.", ScoreWarning, stacklevel=3)

    @property
    def only(self) -> str:
        """Text about left-out notes for an error, as ``", only 1 note off..."``; may be empty."""
        return f", only {self}" if self._notes else ""

    def __str__(self) -> str:
        """Return ``"2 notes without length (D4 at 1 s, E4 at 2 s)"``; empty without notes."""
        return " and ".join(
            f"{len(self._notes[kind])} note{'s' * (len(self._notes[kind]) > 1)} {kind} "
            f"({_first(self._notes[kind])})"
            for kind in ("without length", "off the keyboard")
            if kind in self._notes
        )


def _first(events: Sequence[tuple[float, int]]) -> str:
    named = [f"{pitch_name(pitch)} at {time:g} s" for time, pitch in sorted(events)[:_MOST_NAMED]]
    return ", ".join(named) + (", ..." if len(events) > _MOST_NAMED else "")


def chosen_parts(path: Path, names: Sequence[str], chosen: Sequence[str | int]) -> set[int]:
    """Find the indices of the parts of a file chosen by name, or by number from 1.

    Raises:
        ScoreError: If there is no such part.
    """
    found: set[int] = set()
    plain = [" ".join(name.split()).casefold() for name in names]
    for one in chosen:
        wanted = " ".join(str(one).split())
        indices = {index for index, name in enumerate(plain) if name == wanted.casefold()}
        if not indices and (read_whole(wanted) or 0) in range(1, len(names) + 1):
            indices = {int(wanted) - 1}
        if not indices:
            there = ", ".join(f"{number} {name!r}" for number, name in enumerate(names, start=1))
            raise ScoreError(f"{str(path)!r} has no part {wanted!r}: expected some of {there}.")
        found |= indices
    return found


def write_score_file(path: Path, content: bytes) -> None:
    """Write the bytes of a score atomically.

    Raises:
        ScoreError: If the file cannot be written.
    """
    try:
        write_bytes(path, content)
    except OSError as error:
        raise ScoreError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error
