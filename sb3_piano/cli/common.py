"""What several commands need."""

from __future__ import annotations

import argparse
from pathlib import Path

from sb3_piano.exceptions import ConfigError

EXIT_OK, EXIT_ERROR, EXIT_INTERRUPTED = 0, 2, 130

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


def check_output_file(option: str, file: Path | None) -> None:
    """Refuse a file that cannot be written, before anything is done.

    Raises:
        ConfigError: If it is a folder, or in a folder that does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{option} is '{file}': expected a file in a folder that exists.")


def print_narrowness(n_values: int) -> None:
    """Say that intervals from few values promise too much, if there are few."""
    if n_values < _FEW_VALUES:
        print(
            f"An interval from so few values ({n_values}) is too narrow: 3 cover the mean in "
            "73 % of cases, 5 in 82 %."
        )
