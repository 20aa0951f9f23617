"""Links in folders that come from elsewhere, through which nothing is written."""

from __future__ import annotations

import os
from pathlib import Path

from sb3_piano.exceptions import RunError

_KEPT: set[Path] = set()


def keep_inside(folder: Path) -> None:
    """From now on refuse to write in a folder through links that lead out of it.

    Whoever made the folder may have put them there. Links above it are the user's own.
    """
    _KEPT.add(Path(os.path.abspath(folder)))


def check_inside(path: Path) -> None:
    """Refuse a path that leads out of a folder of :func:`keep_inside` by a link.

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
    """Make a folder that is to be written into, with those above it, unless it is there.

    Raises:
        RunError: As of :func:`check_inside`.
        OSError: If it cannot be made.
    """
    check_inside(path)
    path.mkdir(parents=True, exist_ok=True)
