"""Refuse to write through links that lead out of untrusted folders."""

from __future__ import annotations

import os
from pathlib import Path

from sb3_piano.exceptions import RunError

_KEPT: set[Path] = set()


def keep_inside(folder: Path) -> None:
    """From now on refuse to write through links that lead out of a folder.

    The folder's author may have put them there. Links above it are the user's own.
    """
    _KEPT.add(Path(os.path.abspath(folder)))


def check_inside(path: Path) -> None:
    """Refuse a path that leaves a folder of :func:`keep_inside` through a link.

    Raises:
        RunError: If it does.
    """
    path = Path(os.path.abspath(path))
    real = os.path.realpath(path)
    for folder in path.parents:
        if folder in _KEPT and not Path(real).is_relative_to(os.path.realpath(folder)):
            raise RunError(
                f"'{path}' leads out of '{folder}' by a link, to '{real}', where nothing is "
                "written: expected no such link. Remove it, and give the same command again."
            )


def make_folder(path: Path) -> None:
    """Create a folder and its parents, unless it exists.

    Raises:
        RunError: As of :func:`check_inside`.
        OSError: If it cannot be created.
    """
    check_inside(path)
    path.mkdir(parents=True, exist_ok=True)
