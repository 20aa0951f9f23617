"""Locks that a process holds for as long as it lives: the kernel frees them, however it dies."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from sb3_piano.exceptions import RunError
from sb3_piano.files import read_file
from sb3_piano.links import make_folder

LOCK_SUFFIX = ".lock"
_POLL_SECONDS = 0.01


@contextlib.contextmanager
def hold(path: Path, busy: str = "", expected: str = "") -> Iterator[None]:
    """Hold the lock that a file stands for; processes that are forked meanwhile do not hold it.

    The file says who has the lock, and is removed afterwards. It stays if the process dies.

    Args:
        path: The file, which is made if need be, as is its folder.
        busy: What is told if another has the lock, such as ``'x' is being trained``; by default
            that one is waited for.
        expected: What is expected instead.

    Raises:
        RunError: If another has the lock, or the file cannot be made or locked.
    """
    lock = FileLock(path, blocking=not busy, poll_interval=_POLL_SECONDS)
    try:
        make_folder(path.parent)
        lock.acquire()
    except Timeout:
        raise RunError(f"{busy} by {_owner(path)}: expected {expected}") from None
    except OSError as error:
        raise RunError(
            f"'{path}' cannot be locked: {error.strerror}. Expected a folder on a disk of this "
            "machine, in which files can be made."
        ) from error
    try:
        with contextlib.suppress(OSError):  # a full disk is no reason not to go on
            path.write_text(f"process {os.getpid()} on {socket.gethostname()}")
        yield
    finally:
        if lock.is_locked:  # not in a forked process
            with contextlib.suppress(OSError):  # a system that removes no open files
                path.unlink()  # who waits for it sees that it has no name, and makes a new one
            lock.release()


def _owner(path: Path) -> str:
    try:
        return read_file(path, 1000).decode() or "another process"
    except (OSError, UnicodeDecodeError):  # it has just gone, or the system shows no locked files
        return "another process"
