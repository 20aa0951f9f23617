"""The command line: find the command, run it, tell what went wrong."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import sb3_piano
from sb3_piano.cli import (
    bench,
    clone,
    compare,
    evaluate,
    pieces,
    plan,
    play,
    record,
    report,
    train,
    tune,
)
from sb3_piano.cli.common import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_OK
from sb3_piano.exceptions import PlanWarning, SB3PianoError, ScoreWarning
from sb3_piano.files import disk_refusal

# torch and the simulator are imported by the commands that need them, so that --help is instant.
_COMMANDS = (train, plan, tune, evaluate, compare, play, report, record, clone, pieces, bench)

_OURS = (PlanWarning, ScoreWarning)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments; by default those of the process.

    Returns:
        0 if all went well, 2 after an error of the user's, 130 after Ctrl-C.
    """
    arguments = _parser().parse_args(argv)
    try:
        with _warnings_told():
            status = int(arguments.command(arguments))
        sys.stdout.flush()  # so that what goes wrong with it is told below
        return status
    except SB3PianoError as error:
        print(f"sb3-piano: error: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print("sb3-piano: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # nobody reads on, as in "sb3-piano evaluate RUN | head"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's last flush
        return EXIT_ERROR
    except Exception as error:
        refusal = disk_refusal(error)
        if refusal is None:
            raise
        print(
            f"sb3-piano: error: A file cannot be written: {refusal}. What was finished before is "
            "safe; when there is room, give the same command again.",
            file=sys.stderr,
        )
        return EXIT_ERROR


@contextlib.contextmanager
def _warnings_told() -> Iterator[None]:
    """Tell what was left out of a file and what cannot be played in plain words, and once."""
    told: set[str] = set()
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(
            message: Warning | str, category: type[Warning], *place: Any, **options: Any
        ) -> None:
            if not issubclass(category, _OURS):
                others(message, category, *place, **options)
            elif str(message) not in told:
                told.add(str(message))
                print(f"sb3-piano: warning: {message}", file=sys.stderr)

        warnings.showwarning = show
        for category in _OURS:
            warnings.simplefilter("always", category)
        yield


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sb3-piano",
        description="Train robot hands to play the piano, and hear what they play.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {sb3_piano.__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for module in _COMMANDS:
        module.add_parser(commands)
    presets = commands.add_parser("presets", help="list the YAML files that come with the package")
    presets.set_defaults(command=_presets)
    envs = commands.add_parser("envs", help="list the environment ids")
    envs.set_defaults(command=_envs)
    return parser


def _presets(arguments: argparse.Namespace) -> int:
    from sb3_piano.hyperparams import PRESETS

    del arguments  # every command gets them
    for path in PRESETS.values():
        print(path)
    return EXIT_OK


def _envs(arguments: argparse.Namespace) -> int:
    from sb3_piano.envs import ENV_IDS
    from sb3_piano.envs.registration import imported_ids

    del arguments  # every command gets them
    for env_id in (*ENV_IDS, *imported_ids()):
        print(env_id)
    return EXIT_OK
