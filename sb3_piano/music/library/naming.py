"""Names for imported pieces: what a file is called, made fit for an environment's id."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from pathlib import Path

from sb3_piano.exceptions import ConfigError

_LONGEST = 100
"""Longest name, in characters: file systems take 255 bytes, the suffix included."""

_NAME = re.compile(r"\w[\w-]*")


def slug(text: str) -> str:
    """Return a text as a name: ``"Für Elise (1810).2"`` as ``"Fur-Elise-1810-2"``.

    Letters lose their accents; whatever is neither letter, digit nor underscore becomes a hyphen.
    """
    decomposed = unicodedata.normalize("NFKD", text)
    letters = "".join(mark for mark in decomposed if not unicodedata.combining(mark))
    words = re.sub(r"[\W]+", "-", unicodedata.normalize("NFC", letters))
    return words[:_LONGEST].strip("-_") or "piece"


def check_name(name: str, reserved: Callable[[str], bool]) -> None:
    """Refuse a name that a piece in the library cannot have.

    Raises:
        ConfigError: If it has other characters than an id takes, is too long, or belongs to a
            piece that comes with the package.
    """
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        raise ConfigError(
            f"A piece cannot be named {name!r}: expected letters, digits, hyphens and "
            f"underscores, at most {_LONGEST}, such as {slug(name)!r}."
        )
    if reserved(name):
        raise ConfigError(
            f"A piece cannot be named {name!r}: a piece that comes with the package is. Expected "
            "another name."
        )


def free_name(path: Path, is_free: Callable[[str], bool]) -> str:
    """Return a name for the piece in a file that is free, near to the file's own.

    Args:
        path: The file; if its own name is taken, the folder's name is put in front, then a number
            behind.
        is_free: Tells whether a name may be used.
    """
    plain = slug(path.stem)
    longer = slug(f"{path.absolute().parent.name} {path.stem}")
    for name in (plain, longer):
        if is_free(name):
            return name
    number = 2
    while not is_free(name := f"{longer[: _LONGEST - 8]}-{number}"):
        number += 1
    return name
