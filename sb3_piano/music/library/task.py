"""The import of one piece, which any process can do."""

from __future__ import annotations

import logging
import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.difficulty import features
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering
from sb3_piano.music.library.found import Found
from sb3_piano.music.library.store import Library
from sb3_piano.music.score import Score

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Task:
    """A piece to import.

    Attributes:
        found: The piece.
        names: Its names in the library, each with its collection.
        folder: The library's folder.
        fingering: As in :func:`~sb3_piano.music.fingering.apply.apply_fingering`.
        setting: What is to be noted of it, so that the same import is known again.
        sha256: Checksum of the file.
    """

    found: Found
    names: tuple[tuple[str, str], ...]
    folder: Path
    fingering: str
    setting: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of the import of a piece.

    Attributes:
        error: Why it failed, or None if it did not.
        notes: What else there is to say, such as what was left out.
    """

    error: str | None = None
    notes: tuple[str, ...] = ()


def run_task(task: Task) -> Outcome:
    """Import a piece; whatever is wrong with it becomes part of the outcome."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            error = _import(task)
        except Exception as unforeseen:
            # One file of thousands, from anywhere, must not end the import of the others.
            _logger.debug("Import of '%s' failed", task.found.path, exc_info=True)
            error = f"{type(unforeseen).__name__}: {unforeseen}"
    notes = [str(item.message) for item in caught if issubclass(item.category, ScoreWarning)]
    return Outcome(error=error, notes=tuple(notes))


def _import(task: Task) -> str | None:
    found, library = task.found, Library(task.folder)
    try:
        read = found.read(found.path)
        score = apply_fingering(read, task.fingering)
    except ScoreError as error:
        return str(error)
    known: dict[str, Any] = {
        "source": found.source,
        "fingering": _who_chose(read, score, task),
        "path": str(found.path.absolute()),
        "sha256": task.sha256,
        "setting": task.setting,
        "features": _features(score),
    }
    for name, collection in task.names:
        title = found.title or found.path.stem
        library.add(score, name, collection=collection, title=title, **known)
    return None


def _who_chose(read: Score, score: Score, task: Task) -> str:
    """Return in a word or two who chose the fingers."""
    if task.fingering not in FINGERINGS:
        return f"file {Path(task.fingering).name}"
    if not score.has_fingering:
        return "optimal transport" if task.fingering == "optimal-transport" else "none"
    if not read.has_fingering:
        return "ergonomic"
    is_whole = all(note.finger != UNKNOWN_FINGER for note in read.notes)
    by = task.found.labelled_by
    return by if is_whole or read == score else f"{by}, ergonomic"


def _features(score: Score) -> dict[str, Any] | None:
    try:
        return asdict(features(score))
    except ScoreError:
        return None  # no two hands can play it; it can be listened to all the same
