"""What several commands need."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError

EXIT_OK, EXIT_ERROR, EXIT_INTERRUPTED = 0, 2, 130

_FILE_WIDTH = 160
"""Room for a table in a file, in characters."""

# See sb3_piano.training.statistics.bootstrap_interval, where the figures come from.
_FEW_VALUES = 10


def whole_number(text: str) -> int:
    """Read a whole number from 1 on, also written as ``1e5``."""
    try:
        number = float(text)
        if number < 1 or number != int(number):
            raise ValueError
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no whole number from 1 on, such as 1000 or 1e5"
        ) from None
    return int(number)


def what_is_played(
    env_id: str | None, midi: str | None, instead: str = ""
) -> tuple[str, dict[str, Any]]:
    """Return the environment that ``--env`` and ``--midi`` stand for, and settings to go with it.

    Args:
        env_id: The value of ``--env``, if it is given.
        midi: The value of ``--midi``, if it is given.
        instead: What else the command takes, for the error if neither is.

    Raises:
        ConfigError: If neither is given, or the environment plays one piece only.
    """
    from sb3_piano.envs import GENERAL_ID

    if midi is None:
        if env_id is None:
            raise ConfigError(f"Nothing to play: expected --env ID{instead or ' or --midi FILE'}.")
        return env_id, {}
    if env_id not in (None, GENERAL_ID):
        raise ConfigError(
            f"--midi cannot be given with --env {env_id}: only {GENERAL_ID} plays any piece. "
            "Expected --midi alone."
        )
    return GENERAL_ID, {"env_kwargs": {"score": midi}}


def check_output_file(option: str, file: Path | None) -> None:
    """Refuse a file that cannot be written, before anything is done.

    Raises:
        ConfigError: If it is a folder, or in a folder that does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{option} is '{file}': expected a file in a folder that exists.")


def print_table(table: Any) -> None:
    """Print a table of rich's, with all the room it needs where no terminal limits it."""
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, _FILE_WIDTH)  # rich takes a file for 80 columns wide
    console.print(table)


def print_narrowness(n_values: int) -> None:
    """Say that intervals from few values promise too much, if there are few."""
    if n_values < _FEW_VALUES:
        print(
            f"An interval from so few values ({n_values}) is too narrow: 3 cover the mean in "
            "73 % of cases, 5 in 82 %."
        )
