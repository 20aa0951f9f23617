"""Beginning of a folder that work is done in: its settings, and where it comes from."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

import sb3_piano
from sb3_piano.exceptions import RunError
from sb3_piano.files import write_yaml
from sb3_piano.locks import LOCK_SUFFIX
from sb3_piano.unfinished import PARTIAL_SUFFIX

PROVENANCE = "run.yml"
"""Name of the file that notes where a folder comes from."""

_PACKAGES = ("stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "numpy", "torch")


def is_empty(place: Path) -> bool:
    """Return whether a folder has nothing but what a process that was killed at once left there."""
    names = {found.name for found in place.iterdir()} - {LOCK_SUFFIX, PROVENANCE}
    return all(name.endswith(PARTIAL_SUFFIX) for name in names)


def begin_or_go_on(
    file: Path, what: str, ours: Mapping[str, Any], theirs: Mapping[str, Any] | None, seed: int
) -> None:
    """Write settings into a new folder, or check them against those that a file there has.

    Args:
        file: The file of the settings.
        what: Is done there.
        ours: The settings.
        theirs: What the file has; ``None`` if there is none.
        seed: What is noted as the seed.

    Raises:
        RunError: If the settings differ, a folder without them is not empty, or cannot be written.
    """
    place = file.parent
    if theirs is not None:
        for name in ours:
            found = _difference(name, theirs.get(name), ours[name])
            if found is not None:
                raise RunError(
                    f"The {what} in '{place}' has {found}: expected the same settings, or another "
                    "folder."
                )
        return
    if not is_empty(place):
        raise RunError(f"Folder '{place}' is not empty: expected a new or empty one.")
    try:
        write_yaml(place / PROVENANCE, provenance(seed))
        write_yaml(file, ours)
    except OSError as error:
        raise unwritable(place, error) from error


def _difference(name: str, theirs: Any, ours: Any) -> str | None:
    """Return the first difference between two values, as ``"seed 0, not 1"``."""
    if theirs == ours:
        return None
    if isinstance(theirs, Mapping) and isinstance(ours, Mapping):
        for key in dict.fromkeys((*theirs, *ours)):
            found = _difference(f"{name}.{key}", theirs.get(key), ours.get(key))
            if found is not None:
                return found
    return f"{name} {theirs}, not {ours}"


def unwritable(place: Path, error: OSError) -> RunError:
    """Return the error of a folder that refuses a file."""
    return RunError(
        f"Folder '{place}' cannot be written: {error.strerror or error}. Expected a place in which "
        "files can be made."
    )


def provenance(seed: int | None) -> dict[str, Any]:
    """Return what the folder of a run with this seed notes beside the config, in YAML's types."""
    return {
        "command": shlex.join(sys.orig_argv),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "seed": seed,
        "torch_threads": torch.get_num_threads(),
        "matmul_precision": torch.get_float32_matmul_precision(),
        "versions": {
            "sb3_piano": sb3_piano.__version__,
            **{package: importlib.metadata.version(package) for package in _PACKAGES},
            "python": platform.python_version(),
        },
    }
