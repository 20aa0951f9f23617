"""Read files that a user names."""

from __future__ import annotations

import contextlib
import os
import reprlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from sb3_piano.exceptions import ScoreError, one_line
from sb3_piano.files import read_file

T = TypeVar("T")


def read_whole(text: str) -> int | None:
    """Parse a number of at most 9 digits; return ``None`` for other text.

    Python itself refuses numbers of thousands of digits, with an error that names no file.
    """
    return int(text) if text.isdecimal() and len(text) < 10 else None


def is_hidden(name: str) -> bool:
    """Return whether a file name is hidden, or one of macOS's "._" copies."""
    return name.startswith((".", "__MACOSX"))


def read_text(path: Path, kind: str) -> str:
    """Read a UTF-8 text file, without a byte order mark; ``kind`` is for messages.

    Raises:
        ScoreError: If there is no such file, or it cannot be read as text.
    """
    with reading(path, kind, "UTF-8 text"):
        return read_file(path).decode("utf-8-sig")


@contextlib.contextmanager
def reading(path: Path, kind: str, expected: str) -> Iterator[None]:
    """Context manager that turns any error into a ``ScoreError`` with the file and the reason.

    Raises:
        ScoreError: If there is no such file, or the block raises an error.
    """
    if not os.path.isfile(path):  # which also answers for a name that no file can have
        raise ScoreError(f"There is no {kind} {str(path)!r}: expected an existing file.")
    try:
        yield
    except ScoreError:
        raise
    except Exception as error:
        # Parsers raise any error for a damaged file.
        raise ScoreError(
            f"Cannot read {str(path)!r} as a {kind} ({one_line(error)}): expected {expected}."
        ) from error


def read_field(where: str, name: str, text: str, convert: Callable[[str], T], expected: str) -> T:
    """Convert the text of a field by a function that may raise ValueError.

    Raises:
        ScoreError: If it is not valid.
    """
    try:
        return convert(text)
    except ValueError as error:
        raise ScoreError(
            f"{where}: {name} {reprlib.repr(text)} is not valid: expected {expected}."
        ) from error
