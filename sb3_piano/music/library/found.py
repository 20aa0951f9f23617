"""Files that were found: pieces that may be imported, and those that cannot be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.music.formats import read_score
from sb3_piano.music.score import Score


@dataclass(frozen=True, kw_only=True)
class Found:
    """A piece in a file.

    Attributes:
        path: The file.
        source: Where the notes come from, in one line.
        title: What people call the piece; None if that is not known.
        names: The names under which it belongs into the library, each with its collection; empty
            if any name will do.
        labelled_by: Who chose the fingers that are in the file, in a word or two.
        fingering: How fingers are chosen unless the user says otherwise.
        read: Makes the score of the path. Other processes must be able to import it.
    """

    path: Path
    source: str
    title: str | None = None
    names: tuple[tuple[str, str], ...] = ()
    labelled_by: str = "its file"
    fingering: str = "ergonomic"
    read: Callable[[Path], Score] = read_score


@dataclass(frozen=True)
class Unusable:
    """A file that is not imported, or only in part, and why."""

    path: Path
    reason: str
