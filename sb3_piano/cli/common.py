"""What several commands need."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names

TRUST = (
    "Trust: the model.zip and vecnormalize.pkl of a run are Python pickles, and loading one runs "
    "whatever code is in it; config.yml and --config import the modules that they name, and a data "
    "set makes the environment that it names. So use those only of people whom you trust. Runs "
    "that 'sb3-piano share' wrote have no pickles: a folder with policy.safetensors is played "
    "without unpickling anything."
)
"""What the help of every command says that loads a run, settings or a data set."""

EXIT_OK, EXIT_ERROR, EXIT_INTERRUPTED = 0, 2, 130

NUM_THREADS_HELP = "threads of torch; default: 1, or as OMP_NUM_THREADS or MKL_NUM_THREADS says"

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


def add_piece_arguments(add: Callable[..., Any]) -> None:
    """Add the arguments that say what is played: ``--env``, ``--midi`` and ``--fingering``."""
    add("--env", metavar="ID", help="environment id; 'sb3-piano envs' lists ours")
    add(
        "--midi",
        "--score",
        metavar="FILE",
        help="play a file, such as MIDI, or a piece by its name",
    )
    add(
        "--fingering",
        metavar="HOW",
        help="keep (default): labels as they are; ergonomic: find fingers for notes without; "
        "robot: those that suit the simulated hands; optimal-transport: no labels; or a file",
    )


def what_is_played(arguments: argparse.Namespace, instead: str = "") -> tuple[str, dict[str, Any]]:
    """Return the environment that ``--env`` and ``--midi`` stand for, and settings to go with it.

    Args:
        arguments: With those of :func:`add_piece_arguments`.
        instead: What else the command takes, for the error if neither is.

    Raises:
        ConfigError: If neither is given, or the environment plays one piece only.
    """
    from sb3_piano.envs import GENERAL_ID

    env_id, midi, fingering = arguments.env, arguments.midi, arguments.fingering
    options = {} if fingering is None else {"fingering": fingering}
    if midi is None:
        if env_id is None:
            raise ConfigError(f"Nothing to play: expected --env ID{instead or ' or --midi FILE'}.")
        return env_id, {"env_kwargs": options} if options else {}
    if env_id not in (None, GENERAL_ID):
        raise ConfigError(
            f"--midi cannot be given with --env {env_id}: only {GENERAL_ID} plays any piece. "
            "Expected --midi alone."
        )
    return GENERAL_ID, {"env_kwargs": {"score": midi, **options}}


def env_options(settings: Iterable[str]) -> dict[str, Any]:
    """Return the options of an environment that ``--set`` was given as ``NAME=VALUE``.

    Raises:
        ConfigError: If one has another form, or a value that is no YAML.
    """
    from sb3_piano.training.yaml_config import parse_yaml

    found = {}
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not (name and equals):
            raise ConfigError(f"--set is {setting!r}: expected NAME=VALUE.")
        try:
            found[name] = parse_yaml(text)
        except ConfigError as error:
            raise ConfigError(f"--set is {setting!r}: its value {error}") from error
    return found


def check_output_file(option: str, file: Path | None) -> None:
    """Refuse a file that cannot be written, before anything is done.

    Raises:
        ConfigError: If it is a folder, or in a folder that does not exist.
    """
    if file is not None and (file.is_dir() or not file.parent.is_dir()):
        raise ConfigError(f"{option} is '{file}': expected a file in a folder that exists.")


def check_collection(collection: str, known: Iterable[str]) -> None:
    """Refuse a collection that no piece is of.

    Args:
        collection: The value of ``--collection``.
        known: The collections of the pieces there are.

    Raises:
        ConfigError: If there is none of that name.
    """
    names = sorted(set(known))
    if collection not in names:
        raise ConfigError(
            f"No piece is of the collection {collection!r}.{near_names(collection, names)} "
            f"Expected one of {', '.join(names)}."
        )


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
