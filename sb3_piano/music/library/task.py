"""The import of pieces, in several processes, of which one may be killed."""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import signal
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.difficulty import features
from sb3_piano.music.fingering.apply import FINGERINGS, apply_fingering
from sb3_piano.music.library.datasets import Found
from sb3_piano.music.library.store import Library
from sb3_piano.music.score import Score

_KILLED = "the process that read it was killed; is there memory enough?"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class ImportTask:
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


def run_tasks(
    tasks: Sequence[ImportTask], jobs: int, tell: Callable[[ImportTask, Outcome], None]
) -> bool:
    """Do tasks, and tell of each how it went, in the order in which they are done.

    After Ctrl-C what is being done is finished, and told; nothing new is begun.

    Args:
        tasks: What there is to do.
        jobs: How many processes work; with one, for one task, or on a system without the
            processes and signals of POSIX, it is this one.
        tell: Is called in this process.

    Returns:
        Whether Ctrl-C came.
    """
    with stop_on_signal() as stop:
        if (
            min(jobs, len(tasks)) <= 1
            or "forkserver" not in multiprocessing.get_all_start_methods()
        ):
            for task in tasks:
                if stop.made:
                    break
                tell(task, run_task(task))
            return stop.made
        left = list(tasks)
        while left and not stop.made:
            left = _run_until_broken(left, min(jobs, len(left)), tell, stop)
            # Only what was begun can have killed its process: tasks are begun in order, and one
            # more than there are processes waits with them.
            begun, left = left[: 2 * jobs + 1], left[2 * jobs + 1 :]
            for task in begun:
                if not stop.made and _run_until_broken([task], 1, tell, stop):
                    tell(task, Outcome(error=_KILLED))
        return stop.made


def _run_until_broken(
    tasks: Sequence[ImportTask],
    jobs: int,
    tell: Callable[[ImportTask, Outcome], None],
    stop: StopRequest,
) -> list[ImportTask]:
    """Do tasks until all are done, a process is killed or Ctrl-C; return what is left."""
    # Processes are forked from one without threads or a simulator, started once for all.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    pool = ProcessPoolExecutor(jobs, mp_context=context)
    futures: dict[Future[Outcome], ImportTask] = {}
    done: set[int] = set()

    def tell_of(future: Future[Outcome]) -> None:
        task = futures[future]
        if id(task) not in done and not future.cancelled() and future.exception() is None:
            done.add(id(task))
            tell(task, future.result())

    # From a terminal Ctrl-C reaches the processes, too, which inherit the mask: only this one acts.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        with contextlib.suppress(BrokenProcessPool):
            futures.update((pool.submit(run_task, task), task) for task in tasks)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for future in as_completed(futures):
            tell_of(future)
            if stop.made:
                break
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        pool.shutdown(wait=True, cancel_futures=True)
        for future in futures:
            if future.done():
                tell_of(future)
    return [task for task in tasks if id(task) not in done]


def run_task(task: ImportTask) -> Outcome:
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


def _import(task: ImportTask) -> str | None:
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


def _who_chose(read: Score, score: Score, task: ImportTask) -> str:
    """Return in a word or two who chose the fingers."""
    if task.fingering not in FINGERINGS:
        return f"file {Path(task.fingering).name}"
    if not score.has_fingering:
        return "optimal transport" if task.fingering == "optimal-transport" else "none"
    if task.fingering == "robot" and score != read:
        return "robot"
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
