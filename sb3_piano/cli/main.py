"""The command line: find the command, run it, tell what went wrong."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import sb3_piano
from sb3_piano.cli import (
    bench,
    compare,
    corpus,
    curriculum,
    demonstrations,
    distill,
    evaluate,
    export,
    pieces,
    plan,
    play,
    results,
    sweep,
    train,
    tune,
)
from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_OK,
    add_command,
    check_output_file,
    tell_errors,
    tell_interrupted,
)
from sb3_piano.exceptions import PlanWarning, SB3PianoError, ScoreWarning
from sb3_piano.files import disk_refusal
from sb3_piano.interrupts import ended_as_by_ctrl_c

# torch and the simulator are imported by the commands that need them, so that --help is instant.
_ADDED = (
    train.add_parser,
    curriculum.add_parser,
    sweep.add_parser,
    plan.add_parser,
    tune.add_parser,
    evaluate.add_parser,
    compare.add_parser,
    results.add_parser,
    play.add_parser,
    play.add_report_parser,
    demonstrations.add_parser,
    corpus.add_parser,
    distill.add_parser,
    pieces.add_parser,
    export.add_parser,
    bench.add_parser,
)

_OURS = (PlanWarning, ScoreWarning)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments; by default those of the process.

    Returns:
        0 if all went well, 2 after an error of the user's, 130 after Ctrl-C.
    """
    arguments = _parser().parse_args(argv)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a title in other letters must not end a command
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        for option in ("csv", "json"):
            check_output_file(f"--{option}", getattr(arguments, option, None))
        with _warnings_told(), ended_as_by_ctrl_c():
            status = int(arguments.command(arguments))
        sys.stdout.flush()  # so that what goes wrong with it is told below
        return status
    except SB3PianoError as error:
        return tell_errors(error)
    except KeyboardInterrupt:
        return tell_interrupted(True)
    except BrokenPipeError:  # nobody reads on, as in "sb3-piano evaluate RUN | head"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's last flush
        return EXIT_ERROR
    except Exception as error:
        refusal = disk_refusal(error)
        if refusal is None:
            raise
        return tell_errors(
            f"A file cannot be written: {refusal}. What was finished before is safe; when there is "
            "room, give the same command again."
        )


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
    for add_parser in _ADDED:
        add_parser(commands)
    add_command(commands, "presets", _presets, "list the YAML files that come with the package")
    add_command(commands, "envs", _envs, "list the environment ids")
    return parser


def _presets(arguments: argparse.Namespace) -> int:
    from sb3_piano.hyperparams import FINE_TUNING, NAMED, PRESETS

    for files in (PRESETS, *NAMED.values(), FINE_TUNING):
        print(*files.values(), sep="\n")
    return EXIT_OK


def _envs(arguments: argparse.Namespace) -> int:
    from sb3_piano.envs import ENV_IDS
    from sb3_piano.envs.registration import imported_ids

    print(*ENV_IDS, *imported_ids(), sep="\n")
    return EXIT_OK
