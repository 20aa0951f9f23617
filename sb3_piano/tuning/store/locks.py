"""Locks in a study's folder, by which processes know which of its workers live."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import socket
from collections.abc import Iterator
from pathlib import Path

from sb3_piano import locks
from sb3_piano.exceptions import RunError
from sb3_piano.tuning.study_folder import StudyFolder

_NAME = re.compile(r".+-\d+-[0-9a-f]{8}")  # other locks of the folder look different


@contextlib.contextmanager
def worker_lock(folder: StudyFolder) -> Iterator[str]:
    """Show other processes that a worker lives; the value is its name.

    That is made of host, process id and something random. The lock's file stays if the worker dies,
    so that others can tell a dead worker from one that works on another machine.

    Raises:
        RunError: If the file cannot be made or locked.
    """
    name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
    with locks.hold(_file(folder, name)):
        yield name


def is_held(folder: StudyFolder, name: str) -> bool | None:
    """Return whether a worker lives; ``None`` if there is no file of its lock in this folder."""
    return locks.is_held(_file(folder, name))


def any_held(folder: StudyFolder) -> bool:
    """Return whether any worker of a folder lives."""
    return any(is_held(folder, name) for name in _names(folder))


def dead_workers(folder: StudyFolder, *, of_this_machine: bool = False) -> list[str]:
    """Return the names of the workers that died with their lock in this folder.

    Args:
        folder: The study's folder.
        of_this_machine: Whether to leave out workers of other ones, whose locks may not be seen
            here though they share the folder.
    """
    names = _names(folder)
    if of_this_machine:
        names = [name for name in names if name.rsplit("-", 2)[0] == socket.gethostname()]
    return [name for name in names if is_held(folder, name) is False]


def remove_dead(folder: StudyFolder, name: str) -> None:
    """Remove the file of a worker's lock, unless that worker lives."""
    with contextlib.suppress(_AliveError), locks.hold(_file(folder, name), busy=_AliveError):
        pass  # as the block ends the file goes


class _AliveError(RunError):
    """The worker whose lock should go has not died."""


def _file(folder: StudyFolder, name: str) -> Path:
    return folder.workers_dir / f"{name}{locks.LOCK_SUFFIX}"


def _names(folder: StudyFolder) -> list[str]:
    stems = [file.stem for file in folder.workers_dir.glob(f"*{locks.LOCK_SUFFIX}")]
    return [stem for stem in stems if _NAME.fullmatch(stem)]
