"""Importable files at a path: one file, a folder, or a data set that is known."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats import ACCEPTED_FILES, READERS
from sb3_piano.music.library.datasets import (
    find_pig_folder,
    find_pig_pieces,
    find_robopianist,
    find_snippets,
    unpack_wheel,
)
from sb3_piano.music.library.task import ImportTask, Unusable

_WHEEL = ".whl"

_HEAD = 4096
"""Size of a file's beginning that tells its kind, in bytes."""


@contextlib.contextmanager
def search(path: Path) -> Iterator[tuple[list[ImportTask], list[Unusable]]]:
    """Find the pieces at a path; those in a wheel are there as long as the context is.

    A folder is searched with all folders in it, but for hidden ones. Text and XML files count as
    music if they look like it: folders have readmes, too.

    Raises:
        ScoreError: If there is no such path, or nothing that can be imported.
    """
    if not path.exists():
        raise ScoreError(f"There is no '{path}': expected {ACCEPTED_FILES}, or a folder.")
    if path.suffix == _WHEEL:
        with tempfile.TemporaryDirectory() as folder:
            yield find_snippets(unpack_wheel(path, Path(folder)), path), []
    elif path.is_dir():
        yield _search_folder(path)
    elif path.suffix.lower() in READERS:
        yield [ImportTask(path=path, source=path.name)], []
    else:
        raise ScoreError(
            f"Cannot tell the format of '{path}': expected {ACCEPTED_FILES}, a folder, or a wheel "
            "of robopianist."
        )


def _search_folder(folder: Path) -> tuple[list[ImportTask], list[Unusable]]:
    pig = find_pig_folder(folder)
    if pig is not None:
        return find_pig_pieces(pig), []
    package = find_robopianist(folder)
    if package is not None:
        return find_snippets(package, folder), []
    unusable = []
    titles: dict[Path, str] = {}
    try:
        titles = _read_titles(folder)
    except ScoreError as error:
        unusable.append(Unusable(folder, str(error)))
    found = [
        ImportTask(path=path, title=titles.get(path), source=str(path.relative_to(folder)))
        for path in _music_files(folder)
    ]
    if not found:
        raise ScoreError(f"'{folder}' has no music in it: expected {ACCEPTED_FILES}.")
    return found, unusable


def _music_files(folder: Path) -> Iterator[Path]:
    for place, folders, files in os.walk(folder):
        # In place, so that walk() does not enter the others. macOS packs "._" copies of all files.
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__MACOSX")))
        for name in sorted(files):
            path = Path(place, name)
            if not name.startswith(".") and path.suffix.lower() in READERS and _may_be(path):
                yield path


def _may_be(path: Path) -> bool:
    """Return whether a file of a suffix that others use as well looks like music."""
    suffix = path.suffix.lower()
    if suffix not in (".txt", ".xml"):
        return True
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False
    if suffix == ".xml":
        return b"score-partwise" in head or b"score-timewise" in head
    lines = [line.split() for line in head.splitlines() if not line.lstrip().startswith(b"//")]
    return any(len(fields) in (7, 8) and fields[0].isdigit() for fields in lines[:1])


def _read_titles(folder: Path) -> dict[Path, str]:
    """Return the titles of the files in a folder that has MAESTRO's table, CSV or JSON, if any."""
    tables = sorted(folder.glob("maestro-v*.csv")) or sorted(folder.glob("maestro-v*.json"))
    if not tables:
        return {}
    table = tables[-1]
    try:
        text = table.read_bytes().decode("utf-8-sig")
        is_csv = table.suffix == ".csv"
        rows = csv.DictReader(io.StringIO(text)) if is_csv else _json_rows(json.loads(text))
        return {
            folder / row["midi_filename"]: f"{row['canonical_composer']}: {row['canonical_title']}"
            for row in rows
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError, csv.Error) as error:
        raise ScoreError(
            f"Cannot read '{table}' ({type(error).__name__}: {error}): expected MAESTRO's table "
            "with canonical_composer, canonical_title and midi_filename."
        ) from error


def _json_rows(content: Any) -> Iterable[Mapping[str, str]]:
    """Return the rows of a table that is written row by row (v2) or column by column (v3)."""
    if isinstance(content, list):
        return content
    return [
        {column: values[index] for column, values in content.items()}
        for index in content["midi_filename"]
    ]
