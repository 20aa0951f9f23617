"""Import pieces in several processes, any of which may be killed."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Here, open_executor
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.difficulty import features
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering
from sb3_piano.music.formats import read_score
from sb3_piano.music.library.store import Library
from sb3_piano.music.score import Score
from sb3_piano.text import printable

_KILLED = "the process that read it was killed; is there enough memory?"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ImportTask:
    """A piece in a file, and the settings of its import.

    Attributes:
        path: The file.
        source: Source of the notes, in one line.
        title: Readable title of the piece; None if unknown.
        names: Names for the library, each with its collection; empty while any name will do.
        labelled_by: Source of the file's fingers, in a word or two.
        fingering: As in :func:`~sb3_piano.music.fingering.apply.apply_fingering`; the user's choice
            takes precedence.
        read: Function that reads the score from the path; must be importable in other processes.
        setting: Identity of the fingering, by which a repeated import is recognised.
        sha256: Checksum of the file.
    """

    path: Path
    source: str
    title: str | None = None
    names: tuple[tuple[str, str], ...] = ()
    labelled_by: str = "its file"
    fingering: str = "ergonomic"
    read: Callable[[Path], Score] = read_score
    setting: str = ""
    sha256: str = ""


@dataclass(frozen=True)
class Unusable:
    """A file that is not or only partly imported, and the reason."""

    path: Path
    reason: str


class Outcome(NamedTuple):
    """Result of the import of a piece."""

    error: str | None = None
    """The reason of a failure, or None."""
    notes: tuple[str, ...] = ()
    """Warnings, such as about content left out."""


def run_tasks(
    tasks: Sequence[ImportTask],
    folder: Path,
    jobs: int,
    tell: Callable[[ImportTask, Outcome], None],
) -> bool:
    """Run tasks, and report each outcome in the order in which they finish.

    After Ctrl-C, running tasks finish and are reported; no new one starts. With one job or task,
    this process does the work. ``tell`` is always called in this process.

    Returns:
        Whether Ctrl-C came.
    """
    workers = max(min(jobs, len(tasks)), 1)
    pool = open_executor(workers) if workers > 1 else nullcontext(Here())
    waiting = iter(tasks)
    begun: dict[Future[Outcome], ImportTask] = {}
    with stop_on_signal() as stop, pool as executor:
        while True:
            for task in islice(waiting, 0 if stop.made else workers - len(begun)):
                begun[executor.submit(run_task, task, folder)] = task
            if not begun:
                return stop.made
            for future in wait(begun, return_when=FIRST_COMPLETED).done:
                try:
                    outcome = future.result()
                except BrokenExecutor:
                    outcome = Outcome(error=_KILLED)
                tell(begun.pop(future), outcome)


def run_task(task: ImportTask, folder: Path) -> Outcome:
    """Import a piece; any error becomes part of the outcome."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            error = _import(task, Library(folder))
        except Exception as unforeseen:
            # One bad file of thousands must not end the import of the others.
            _logger.debug("Import of '%s' failed", task.path, exc_info=True)
            error = f"{type(unforeseen).__name__}: {unforeseen}"
    notes = [str(item.message) for item in caught if issubclass(item.category, ScoreWarning)]
    return Outcome(error=error, notes=tuple(notes))


def _import(task: ImportTask, library: Library) -> str | None:
    try:
        read = task.read(task.path)
        score = apply_fingering(read, task.fingering)
    except ScoreError as error:
        return str(error)
    known: dict[str, Any] = {
        "title": printable(task.title or task.path.stem),
        "source": printable(task.source),
        "fingering": _who_chose(read, score, task),
        "path": str(task.path.absolute()),
        "sha256": task.sha256,
        "setting": task.setting,
        "features": asdict(features(score)),
    }
    for name, collection in task.names:
        library.add(score, name, collection=collection, **known)
    return None


def _who_chose(read: Score, score: Score, task: ImportTask) -> str:
    """Describe the source of the fingers in a word or two."""
    if task.fingering not in FINGERINGS:
        return f"file {Path(task.fingering).name}"
    if not score.has_fingering:
        return "optimal transport" if task.fingering == "optimal-transport" else "none"
    if task.fingering == "robot" and score != read:
        return "robot"
    if not read.has_fingering:
        return "ergonomic"
    is_whole = all(note.finger != UNKNOWN_FINGER for note in read.notes)
    return task.labelled_by if is_whole or read == score else f"{task.labelled_by}, ergonomic"
