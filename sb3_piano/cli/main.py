"""Command line: find the command, run it, print errors."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import importlib
import io
import os
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TextIO

import sb3_piano
from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_OK,
    Paragraphs,
    check_output_file,
    command,
    print_errors,
    print_interrupted,
)
from sb3_piano.exceptions import (
    PlanWarning,
    SB3PianoError,
    ScoreWarning,
    no_memory,
    one_line,
)
from sb3_piano.interrupts import ended_as_by_ctrl_c
from sb3_piano.text import escaped, shortened

COMMANDS = {
    "train": (
        "train:add_arguments",
        "train a model, or resume a training",
        "train --env RoboPianist-debug-CMajorScaleTwoHands-v0 --config fast",
    ),
    "curriculum": (
        "curriculum:add_arguments",
        "train a curriculum: each stage starts from the previous model",
        "curriculum curriculum.yml --out runs/curriculum",
    ),
    "sweep": (
        "sweep:add_arguments",
        "train a grid of pieces, algorithms, settings and seeds",
        "sweep grid.yml",
    ),
    "plan": (
        "plan:add_arguments",
        "plan a piece and refine the plan in simulation",
        "plan my.mid --refine 5 --out my.npz",
    ),
    "tune": (
        "tune:add_arguments",
        "search hyperparameters with Optuna",
        "tune --midi my.mid --trials 20",
    ),
    "evaluate": (
        "evaluate:add_arguments",
        "evaluate trained models and other players",
        "evaluate runs/sac/RoboPianist-v0_1 --episodes 5",
    ),
    "compare": (
        "compare:add_arguments",
        "compare two sets of evaluations, piece by piece",
        "compare before.json after.json",
    ),
    "results": (
        "sb3_piano.lab.commands.results:add_arguments",
        "measure, check and tabulate reproducible results of players",
        "results check results.json --all",
    ),
    "play": (
        "play:add_arguments",
        "play a piece, and write video, sound and MIDI",
        "play my.mid --view close",
    ),
    "report": (
        "play:add_report_arguments",
        "write an HTML report: piano roll, fingers, reward, training",
        "report runs/sac/RoboPianist-v0_1",
    ),
    "record": (
        "demonstrations:add_record_arguments",
        "record performances as a data set of demonstrations",
        "record my.mid --out piano/my-v0 --episodes 20",
    ),
    "clone": (
        "demonstrations:add_clone_arguments",
        "train a model by behavioural cloning of a data set",
        "clone piano/my-v0 --algo sac",
    ),
    "corpus": (
        "corpus:add_arguments",
        "record demonstrations of many pieces in parallel, or resume it",
        "corpus repertoire --out corpus --excerpts 40 --seconds 10",
    ),
    "distill": (
        "sb3_piano.lab.commands.distillation:add_arguments",
        "train a policy for any piece by imitating a planned pianist",
        "distill --config distill.yml --out hand",
    ),
    "pieces": (
        "pieces:add_arguments",
        "list, show, import, export, remove and rank pieces",
        "pieces show my.mid",
    ),
    "fingering-from-video": (
        "sb3_piano.lab.commands.video:add_arguments",
        "find the fingers of a filmed pianist",
        "fingering-from-video concert.mp4 score.mid --detector hands/bin/python",
    ),
    "export": (
        "sb3_piano.lab.commands.web:add_arguments",
        "export a run without pickles, or the files of the web page",
        "export runs/sac/RoboPianist-v0_1 my-pianist",
    ),
    "bench": (
        "sb3_piano.lab.commands.bench:add_arguments",
        "measure speed and memory",
        "bench --only simulation",
    ),
    "presets": (
        "main:_add_presets",
        "list the package's YAML files of hyperparameters",
        "presets fast",
    ),
    "envs": (
        "main:_add_envs",
        "list the environment ids and their pieces",
        "envs scale",
    ),
}
"""Function that adds the arguments of a command, its purpose, and an example.

The function's module is in this package or has a full import path. It is imported when its command
is given, so that ``--help`` stays fast.
"""

_FORMER = {
    **{command: {"--run": "--out"} for command in ("clone", "curriculum", "sweep")},
    "train": {"--run": "--out", "--score": "--midi"},
    "tune": {"--score": "--midi"},
    **{command: {"--players": "--player"} for command in ("corpus", "results")},
    "evaluate": {"--score": "--pieces", "--metrics": "--metric"},
    "play": {"--score": "--pieces"},
    "record": {"--policy": "--player"},
}
"""Deprecated options of commands, and the options that replace them."""

_PLAYS = {
    "RoboPianist-v0": "any score",
    "RoboPianist-selfactuated-v0": "any score; keys without hands",
    "debug": "a short piece of RoboPianist's",
    "scale": "a scale",
    "arpeggio": "an arpeggio",
    "hanon": "an exercise of Hanon's",
    "repertoire": "a piece of the repertoire",
    "encore": "an encore, harder than the repertoire",
}
"""Description of an environment's piece, by its id or the prefix of the piece's name."""

_COMPLETION = "print the completion script of a shell, for ~/.local/share/bash-completion"

_LONGEST = 200
"""Greatest length of a library's message about lack of memory, in characters."""

_QUICK = ("presets", "envs")
"""Commands that load no library; the others take seconds before they print."""

_OURS = (PlanWarning, ScoreWarning)


class _PlainText:
    """Stream that escapes control characters of titles and file names.

    Rich writes to the original stream, so that its colours stay.
    """

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        return self.rich_proxied_file.write(escaped(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: The arguments; by default those of the process.

    Returns:
        0 if all went well, 2 after an error of the user's, 130 after Ctrl-C.
    """
    _open_streams()
    given = argv
    if given is None:
        given = sys.argv[1:]
        atexit.register(gc.freeze)  # skips a slow garbage collection of torch at exit
    if isinstance(sys.stdout, io.TextIOWrapper):  # for titles in other alphabets
        sys.stdout.reconfigure(errors="backslashreplace")
    plain: Any = _PlainText
    with (
        contextlib.redirect_stdout(plain(sys.stdout)),
        contextlib.redirect_stderr(plain(sys.stderr)),
    ):
        return _run(given)


def _run(given: Sequence[str]) -> int:
    """Run a command; print errors and return the exit status."""
    try:
        given = renamed(given)
        arguments = parser_of(given).parse_args(given)
        for option in ("csv", "json"):
            check_output_file(f"--{option}", getattr(arguments, option, None))
        if sys.stderr.isatty() and given[0] not in _QUICK:
            print("Loading ...", file=sys.stderr, flush=True)
        with _plain_warnings(), _quiet_threads(), ended_as_by_ctrl_c():
            status = int(arguments.command(arguments))
        sys.stdout.flush()  # here, so that its errors are caught below
        return status
    except SB3PianoError as error:
        return print_errors(error)
    except KeyboardInterrupt:
        return print_interrupted(True)
    except BrokenPipeError:  # the reader has ended, as in "sb3-piano evaluate RUN | head"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for Python's last flush
        return EXIT_ERROR
    except Exception as error:
        message = _machine_error(error)
        if message is None:
            raise
        return print_errors(message)


def renamed(given: Sequence[str]) -> list[str]:
    """Replace deprecated options, and say so."""
    former = _FORMER.get(given[0], {}) if given else {}
    renamed = []
    for argument in given:
        option, equals, value = argument.partition("=")
        if option in former:
            new = former[option]
            print(f"sb3-piano: warning: {option} is now {new}.", file=sys.stderr)
            argument = f"{new}{equals}{value}"
        renamed.append(argument)
    return renamed


def _machine_error(error: BaseException) -> str | None:
    """Return a message for a lack of disk, memory or rights; ``None`` for other errors."""
    from sb3_piano.files import disk_refusal, reading_refusal

    if (refusal := reading_refusal(error)) is not None:
        return f"{refusal}: expected a file or folder that may be read."
    refusal, instead = disk_refusal(error), "room"
    wrong = f"A file cannot be written: {refusal}"
    if refusal is None:
        if not no_memory(error):
            return None
        wrong, instead = f"There is not enough memory: {one_line(error)[:_LONGEST]}", "more"
    return (
        f"{wrong}. What was finished before is safe; when there is {instead}, give the same "
        "command again."
    )


def _open_streams() -> None:
    """Replace streams that were closed at the start of the process (``>&-``) by the null device."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115  as long as the process


@contextlib.contextmanager
def _quiet_threads() -> Iterator[None]:
    """Hide tracebacks of threads that lack disk or memory.

    The command gets the same error: TensorBoard's writer raises it again.
    """
    former = threading.excepthook

    def tell(arguments: threading.ExceptHookArgs) -> None:
        if arguments.exc_value is None or _machine_error(arguments.exc_value) is None:
            former(arguments)

    threading.excepthook = tell
    try:
        yield
    finally:
        threading.excepthook = former


@contextlib.contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print each warning about a score or a plan once, in one line."""
    known: set[str] = set()
    with warnings.catch_warnings():
        others = warnings.showwarning

        def show(
            message: Warning | str, category: type[Warning], *place: Any, **options: Any
        ) -> None:
            if not issubclass(category, _OURS):
                others(message, category, *place, **options)
            elif (text := shortened(str(message))) not in known:
                known.add(text)
                print(f"sb3-piano: warning: {text}", file=sys.stderr)

        warnings.showwarning = show
        for category in _OURS:
            warnings.simplefilter("always", category)
        yield


class _Completion(argparse.Action):
    """Print a script for a shell to complete commands, options and files."""

    def __call__(self, parser: Any, namespace: Any, value: Any, option: Any = None) -> None:
        import shtab

        print(shtab.complete(parser_of(), value))
        parser.exit()


def parser_of(given: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser with the arguments of the given command; by default of all commands."""
    parser = argparse.ArgumentParser(
        prog="sb3-piano",
        description="Train robot hands to play the piano, and hear what they play.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {sb3_piano.__version__}")
    parser.add_argument(
        "--completion", choices=("bash", "zsh", "tcsh"), action=_Completion, help=_COMPLETION
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    first = [argument for argument in given or () if not argument.startswith("-")][:1]
    for name, (place, about, example) in COMMANDS.items():
        own = commands.add_parser(name, help=about, formatter_class=Paragraphs)
        if given is None or name in first:
            where, function = place.split(":")
            module = importlib.import_module(where if "." in where else f"sb3_piano.cli.{where}")
            getattr(module, function)(own)
        about = f"{about[0].upper()}{about[1:]}."
        own.description = f"{about}\n\n  sb3-piano {example}\n\n{own.description or ''}"
    return parser


def _add_presets(parser: Any) -> None:
    option = command(parser, _presets)
    option("text", "TEXT", "list only names with this text", nargs="?")
    option("--zoo", "ALGO", "print a named preset's settings of an algorithm as RL Zoo reads them")


def _add_envs(parser: Any) -> None:
    command(parser, _envs)("text", "TEXT", "list only names with this text", nargs="?")


def _presets(arguments: argparse.Namespace) -> int:
    from sb3_piano.hyperparams import FINE_TUNING, NAMED, PRESETS, purpose

    if arguments.zoo is not None:
        from sb3_piano.settings import refuse_unknown
        from sb3_piano.training.configuration.entries import zoo_preset

        refuse_unknown([str(arguments.text)], NAMED, "preset")
        print(zoo_preset(arguments.zoo, arguments.text), end="")
        return EXIT_OK
    files = [f for files in (PRESETS, *NAMED.values(), FINE_TUNING) for f in files.values()]
    return _print_list({str(file): purpose(file) for file in files}, arguments.text)


def _envs(arguments: argparse.Namespace) -> int:
    from sb3_piano.registration import ENV_IDS, imported_ids

    about = {env_id: _PLAYS.get(env_id) or _PLAYS[env_id.split("-")[1]] for env_id in ENV_IDS}
    imported = dict.fromkeys(imported_ids(), "an imported piece")
    return _print_list(about | imported, arguments.text)


def _print_list(rows: Mapping[str, str], text: str | None) -> int:
    """Print the names that contain a text, with their descriptions."""
    shown = {name: is_ for name, is_ in rows.items() if (text or "").lower() in name.lower()}
    if not shown:
        return print_errors(
            f"Nothing has {text!r} in its name: expected a part of one of {len(rows)} names."
        )
    width = max(map(len, shown))
    for name, is_ in shown.items():
        print(f"{name:{width}}  {is_}")
    return EXIT_OK
