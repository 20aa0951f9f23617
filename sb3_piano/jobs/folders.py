"""Job folders: check that they are empty, or that their settings are the same."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.files import dump_yaml, load_yaml, write_yaml
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX
from sb3_piano.unfinished import PARTIAL_SUFFIX

SETTINGS = "job.yml"
"""Name of the file of a job's settings."""

PROVENANCE = "run.yml"
"""Name of the file with a folder's provenance."""


def shared_folder(folder: str | os.PathLike[str]) -> Path:
    """Return the absolute path of a folder; from now on refuse writes through links out of it.

    Raises:
        ConfigError: If it is a URL.
    """
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
    names = {found.name for found in place.iterdir()} - {PROVENANCE, SETTINGS}
    return all(
        name.endswith(PARTIAL_SUFFIX) or (name[0] == "." and name.endswith(LOCK_SUFFIX))
        for name in names
    )


def begin_or_resume(
    file: Path,
    what: str,
    ours: Mapping[str, Any],
    theirs: Mapping[str, Any] | None = None,
    notes: Mapping[str, Any] | None = None,
) -> None:
    """Write settings into a new folder, or compare them with those already there.

    Args:
        file: The file of the settings.
        what: Kind of the work in messages, such as ``corpus``.
        ours: The settings.
        theirs: Settings in the file; by default they are read.
        notes: Provenance to write into a new folder.

    Raises:
        RunError: If the settings differ, or the folder is not empty or cannot be written.
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
    """Check that settings equal those with which the work was started.

    Raises:
        RunError: If they differ; the message names the first difference.
    """
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
