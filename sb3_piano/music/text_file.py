"""Reading text from files that a user names."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from sb3_piano.exceptions import ScoreError

T = TypeVar("T")


def read_whole(text: str) -> int | None:
    """Return the number that digits stand for; ``None`` for other text, and from 10 digits on.

    Python itself refuses numbers of thousands of digits, with an error that names no file.
    """
    return int(text) if text.isdecimal() and len(text) < 10 else None


def read_field(where: str, name: str, text: str, convert: Callable[[str], T], expected: str) -> T:
    """Return what the text of a field stands for.

    Args:
        where: The place, for messages: ``"Line 3 of 'etude.txt'"``.
        name: What the field is.
        text: What it says.
        convert: Makes a value of it, or raises ValueError.
        expected: What it could say.

    Raises:
        ScoreError: If it is not valid.
    """
    try:
        return convert(text)
    except ValueError as error:
        raise ScoreError(
            f"{where}: {name} {reprlib.repr(text)} is not valid: expected {expected}."
        ) from error


def read_text(path: Path, kind: str) -> str:
    """Return the text of a file in UTF-8, without a byte order mark.

    Args:
        path: The file.
        kind: What it should be, for messages: ``"fingering file"``.

    Raises:
        ScoreError: If there is no such file, or it cannot be read as text.
    """
    if not os.path.isfile(path):  # which also answers for a name that no file can have
        raise ScoreError(f"There is no {kind} {str(path)!r}: expected an existing file.")
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScoreError(
            f"Cannot read {str(path)!r} as a {kind}: {error}; expected UTF-8 text."
        ) from error
