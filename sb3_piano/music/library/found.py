"""A piece that was found and may be imported."""

from __future__ import annotations

import hashlib
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

    def sha256(self) -> str:
        """Return the checksum of the file's content, in hexadecimal digits.

        Raises:
            OSError: If the file cannot be read.
        """
        return hashlib.sha256(self.path.read_bytes()).hexdigest()
