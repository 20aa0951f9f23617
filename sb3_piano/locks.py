"""File locks of a process, which the kernel releases when the process ends."""

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
    """Hold a file lock during the block; forked processes do not hold it.

    The file names the owner, and is removed afterwards. It stays if the process dies.

    Args:
        path: The file; it and its folder are created if missing.
        busy: The message if another process has the lock, such as ``'x' is being trained``; by
            default, wait for the lock.
        expected: The message's advice.

    Raises:
        RunError: If another process has the lock, or the file cannot be created or locked.
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
            "machine that files can be created in."
        ) from error
    try:
        with contextlib.suppress(OSError):  # the lock also works on a full disk
            path.write_text(f"process {os.getpid()} on {socket.gethostname()}")
        yield
    finally:
        if lock.is_locked:  # not in a forked process
            with contextlib.suppress(OSError):  # a system that removes no open files
                path.unlink()  # a waiting process notices that, and makes a new file
            lock.release()


def _owner(path: Path) -> str:
    try:
        return read_file(path, 1000).decode() or "another process"
    except (OSError, UnicodeDecodeError):  # it has just gone, or the system shows no locked files
        return "another process"
