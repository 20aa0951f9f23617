"""Temporary files and folders, owned by their process; others delete a killed process's."""

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
except ImportError:  # Windows, where the owner of a temporary file is unknown
    fcntl = None  # type: ignore[assignment]

PARTIAL_SUFFIX = ".partial"
"""Suffix of a file that is being written; leftovers may be deleted."""

_PARTIAL = re.compile(rf".+\.[0-9a-f]{{16}}{re.escape(PARTIAL_SUFFIX)}")
_cleaned: set[Path] = set()
"""Folders that this process has already cleared of leftovers."""


def own(descriptor: int) -> bool:
    """Own a temporary file or folder while its descriptor is open.

    Returns:
        Whether it still exists: another process may have deleted it before.
    """
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a disk that has no locks
            fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0


def delete_unowned(paths: Iterable[Path]) -> None:
    """Delete temporary files and folders that killed processes left."""
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
    """Yield a temporary file beside ``path`` to write and rename; delete it otherwise.

    Leftovers of killed processes in the folder are deleted too, once per process.
    """
    folder = Path(os.path.realpath(path.parent))
    if folder not in _cleaned:
        delete_unowned(each for each in folder.glob("*") if _PARTIAL.fullmatch(each.name))
        _cleaned.add(folder)
    while True:
        # File names have at most 255 bytes.
        name = f"{path.name[:50]}.{secrets.token_hex(8)}{PARTIAL_SUFFIX}"
        file = path.with_name(name).open("xb")
        if own(file.fileno()):
            break
        file.close()
    try:
        yield file
    finally:
        for end in (file.close, path.with_name(name).unlink):
            with contextlib.suppress(OSError):  # the disk is full, or the file was renamed
                end()


@contextlib.contextmanager
def partial_folder(place: Path, prefix: str) -> Iterator[Path]:
    """Yield a new folder to fill and move to its place; delete the rest.

    Leftovers of killed processes are deleted too.
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
    """Context manager for a temporary folder in the system's usual place."""
    return partial_folder(Path(tempfile.gettempdir()), "sb3-piano-")
