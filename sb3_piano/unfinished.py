"""What is being made: owned by who makes it, and deleted by others if that one was killed."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from io import BufferedWriter
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows, where nobody knows whether what is unfinished has an owner
    fcntl = None  # type: ignore[assignment]

PARTIAL_SUFFIX = ".partial"
"""Suffix of a file that is being written; one that is left over may be deleted."""

_PARTIAL = re.compile(rf".+\.[0-9a-f]{{16}}{re.escape(PARTIAL_SUFFIX)}")
_cleaned: set[Path] = set()
"""Folders in which this process has deleted what killed ones had left."""


def own(descriptor: int) -> bool:
    """Own a file or folder that is not finished as long as it is open, and this process lives.

    Returns:
        Whether it is there: it may have been deleted before it had an owner.
    """
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a disk that has no locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0


def delete_unowned(paths: Iterable[Path]) -> None:
    """Delete files and folders that processes which were killed have left unfinished."""
    for path in paths if fcntl is not None else ():
        with contextlib.suppress(OSError):  # it has an owner, or has just gone
            descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink()
            finally:
                os.close(descriptor)


@contextlib.contextmanager
def partial_file(path: Path) -> Iterator[BufferedWriter]:
    """Give a file beside another, to be written and put in its place; it is deleted otherwise.

    What killed processes have left in the folder is deleted as well, once in a process.
    """
    folder = Path(os.path.realpath(path.parent))
    if folder not in _cleaned:
        delete_unowned(each for each in folder.glob("*") if _PARTIAL.fullmatch(each.name))
        _cleaned.add(folder)
    while True:
        # No longer than the longest name that a file may have, which is 255 bytes.
        name = f"{path.name[:50]}.{secrets.token_hex(8)}{PARTIAL_SUFFIX}"
        file = path.with_name(name).open("xb")
        if own(file.fileno()):
            break
        file.close()
    try:
        yield file
    finally:
        for end in (file.close, path.with_name(name).unlink):
            with contextlib.suppress(OSError):  # the disk is full, or it has taken its place
                end()


@contextlib.contextmanager
def partial_folder(place: Path, prefix: str) -> Iterator[Path]:
    """Give a new folder in which something is made, to be put in its place; the rest is deleted.

    What killed processes have left is deleted as well.
    """
    delete_unowned(place.glob(f"{prefix}*"))
    with contextlib.ExitStack() as stack:
        while True:
            made = Path(tempfile.mkdtemp(prefix=prefix, dir=place))
            if fcntl is None:  # Windows opens no folders
                break
            descriptor = os.open(made, os.O_RDONLY)
            stack.callback(os.close, descriptor)
            if own(descriptor):
                break
        stack.callback(shutil.rmtree, made, ignore_errors=True)
        yield made


def scratch_folder() -> AbstractContextManager[Path]:
    """Give a folder for what nobody needs afterwards, where the system has such."""
    return partial_folder(Path(tempfile.gettempdir()), "sb3-piano-")
