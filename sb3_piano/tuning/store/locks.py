"""Locks that a process holds for as long as it lives: the kernel frees them, however it dies."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import socket
from collections.abc import Collection, Iterator
from pathlib import Path
from types import TracebackType

from sb3_piano.exceptions import RunError
from sb3_piano.tuning.study_folder import StudyFolder

_SUFFIX = ".lock"
_NAME = re.compile(r".+-\d+-[0-9a-f]{8}")  # other locks of the folder look different


class WorkerLock:
    """Shows other processes that a worker lives.

    Its file stays if the worker dies, so that others can tell a dead worker from one that works on
    another machine. Processes that the worker forks do not hold the lock.

    Args:
        folder: The study's folder.

    Attributes:
        name: The worker's name: host, process id and something random.
    """

    def __init__(self, folder: StudyFolder):
        self.name = f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"
        self._file = _file(folder, self.name)
        self._descriptor: int | None = None

    def acquire(self) -> WorkerLock:
        """Take the lock, in a folder that is made if need be.

        Raises:
            RunError: If the file cannot be made or locked.
        """
        while self._descriptor is None:
            descriptor = _open_locked(self._file)
            if _is_there(descriptor, self._file):
                self._descriptor = descriptor
            else:  # someone took the unlocked file for that of a dead worker
                _close(descriptor)
        return self

    def release(self) -> None:
        """Give the lock back and remove its file."""
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None and descriptor in _descriptors:  # not in a forked process
            self._file.unlink(missing_ok=True)
            _close(descriptor)

    def __enter__(self) -> WorkerLock:
        return self.acquire()

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.release()


def is_held(folder: StudyFolder, name: str) -> bool | None:
    """Return whether a worker lives; ``None`` if there is no file of its lock in this folder."""
    with _shared(_file(folder, name)) as is_free:
        return None if is_free is None else not is_free


def any_held(folder: StudyFolder, but: Collection[str] = ()) -> bool:
    """Return whether any worker of a folder lives.

    Args:
        folder: The study's folder.
        but: Names of workers that do not matter.
    """
    return any(is_held(folder, name) for name in _names(folder) if name not in but)


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
    file = _file(folder, name)
    with _shared(file) as is_free:
        if is_free:
            file.unlink(missing_ok=True)


@contextlib.contextmanager
def exclusive(path: Path) -> Iterator[None]:
    """Let only one process of this machine at a time do something; others wait.

    Args:
        path: A file that stands for it, in any folder; it is made if need be.

    Raises:
        RunError: If the file cannot be made or locked.
    """
    descriptor = _open_locked(path)
    try:
        yield
    finally:
        _close(descriptor)


def _file(folder: StudyFolder, name: str) -> Path:
    return folder.workers_dir / f"{name}{_SUFFIX}"


def _names(folder: StudyFolder) -> list[str]:
    stems = [file.stem for file in folder.workers_dir.glob(f"*{_SUFFIX}")]
    return [stem for stem in stems if _NAME.fullmatch(stem)]


def _open_locked(path: Path) -> int:
    """Return a descriptor of a file that is made if need be and locked, by this process alone."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        _descriptors.add(descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        except BaseException:
            _close(descriptor)
            raise
    except OSError as error:
        raise RunError(
            f"'{path}' cannot be locked: {error.strerror}. Expected a folder on a disk of this "
            "machine, in which files can be made."
        ) from error
    return descriptor


def _close(descriptor: int) -> None:
    if descriptor in _descriptors:  # a forked process has closed it already
        _descriptors.remove(descriptor)
        os.close(descriptor)


def _is_there(descriptor: int, path: Path) -> bool:
    """Return whether an open file still has its name."""
    try:
        return os.path.samestat(os.fstat(descriptor), path.stat())
    except FileNotFoundError:
        return False


@contextlib.contextmanager
def _shared(path: Path) -> Iterator[bool | None]:
    """Keep a file from being locked for a moment, and tell whether that was possible.

    The lock is a shared one, so that two processes that look at once see the same. The value is
    ``None`` if there is no such file.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        yield None
        return
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            is_free = False
        else:
            is_free = True
        yield is_free
    finally:
        os.close(descriptor)


# A lock is free when all descriptors are closed, also those that forked processes inherited.
_descriptors: set[int] = set()


def _close_in_child() -> None:
    while _descriptors:
        os.close(_descriptors.pop())


os.register_at_fork(after_in_child=_close_in_child)
