"""Job folders: check that they are empty, or that their settings are the same."""

from __future__ import annotations

import os
from collections.abc import Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import dump_yaml, load_yaml, write_yaml
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX
from sb3_piano.unfinished import PARTIAL_SUFFIX

SETTINGS, PROVENANCE = "job.yml", "run.yml"
"""Names of the files of a job's settings, and of a folder's provenance."""


def shared_folder(folder: str | os.PathLike[str]) -> Path:
    """Return the absolute path of a folder; from now on refuse writes through links out of it."""
    if "://" in os.fspath(folder):
        raise ConfigError(
            f"The folder is {os.fspath(folder)!r}: expected a path of a file system that all "
            "machines see; object storage is not supported."
        )
    place = Path(folder).absolute()
    keep_inside(place)
    return place


def is_empty(place: Path) -> bool:
    """Return whether a folder has at most the leftovers of a process killed at its start."""
    left = (PROVENANCE, SETTINGS, f"*{PARTIAL_SUFFIX}", LOCK_SUFFIX, f".*{LOCK_SUFFIX}")
    return all(any(fnmatch(found.name, name) for name in left) for found in place.iterdir())


def begin_or_resume(
    file: Path,
    what: str,
    ours: Mapping[str, Any],
    theirs: Mapping[str, Any] | None = None,
    notes: Mapping[str, Any] | None = None,
) -> None:
    """Write our settings and notes on provenance into a new folder, or compare with those there.

    ``theirs`` are the settings in the file; by default they are read. A ``RunError``, which calls
    the work ``what``, says that they differ, or that the folder is not empty or not writable.
    """
    place = file.parent
    try:
        if place.is_dir() and not is_empty(place):  # else it has no results yet
            if not file.is_file():
                raise RunError(f"Folder '{place}' is not empty: expected a new or empty one.")
            known = load_yaml(file.read_text("utf-8")) if theirs is None else theirs
            check_same(known, ours, f"The {what} in '{place}'")
            return
        make_folder(place)
        if notes is not None:
            write_yaml(place / PROVENANCE, notes)
        write_yaml(file, ours)
    except OSError as error:
        raise unwritable(place, error) from error


def check_same(theirs: Any, ours: Any, what: str) -> None:
    """Raise ``RunError`` with the first difference unless settings are as when the work began."""
    found = _difference("", theirs, load_yaml(dump_yaml(ours)))
    if found is not None:
        raise RunError(f"{what} has {found}: expected the same settings, or another folder.")


def _difference(name: str, theirs: Any, ours: Any) -> str | None:
    """Return the first difference between two values, as ``"seed 0, not 1"``."""
    if isinstance(theirs, Mapping) and isinstance(ours, Mapping):
        inner = (
            _difference(f"{name}.{key}" if name else str(key), theirs.get(key), ours.get(key))
            for key in dict.fromkeys((*theirs, *ours))
        )
        return next(filter(None, inner), None)
    return None if theirs == ours else f"{name or 'settings'} {theirs}, not {ours}"


def unwritable(place: Path, error: OSError) -> RunError:
    """Return the error for a folder that cannot be written."""
    return RunError(
        f"Folder '{place}' cannot be written: {error.strerror or error}. Expected a place in which "
        "files can be made."
    )
