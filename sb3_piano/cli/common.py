"""Shared options, tables and messages of the commands."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from sb3_piano.exceptions import ConfigError, SB3PianoError
from sb3_piano.hyperparams import NAMED
from sb3_piano.text import escaped

if TYPE_CHECKING:
    from rich.table import Table

TRUST = (
    "Trust: a run's model.zip is a Python pickle, and a config imports the modules that it names: "
    "load them only from people you trust. Folders written by 'sb3-piano export' have no pickles."
)
"""Epilogue of the help of each command that loads a run, settings or a data set."""

EXIT_OK, EXIT_ERROR, EXIT_INTERRUPTED = 0, 2, 130

_FILE_WIDTH = 160
"""Width of a table in a file, in characters."""

# Source of the figures: sb3_piano.training.evaluation.statistics.bootstrap_interval.
_FEW_VALUES = 10


class Paragraphs(argparse.HelpFormatter):
    """Help formatter that keeps paragraphs and indented lines of a description."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = [paragraph for paragraph in text.split("\n\n") if paragraph.strip()]
        return "\n\n".join(
            paragraph
            if paragraph.startswith("  ")
            else super(Paragraphs, self)._fill_text(paragraph, width, indent)
            for paragraph in paragraphs
        )


def whole_number(text: str) -> int:
    """Parse a whole number of at least 1, such as ``1000`` or ``1e5``."""
    try:
        number = float(text)
        if number < 1 or number != int(number):
            raise ValueError
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no whole number from 1 on, such as 1000 or 1e5"
        ) from None
    return int(number)


_SHARED: dict[str, tuple[Any, ...]] = {
    "--best": ("METRIC", "use the best model by f1 or onset_f1 instead of the last"),
    "--physics": (
        "NAME",
        "reference, faithful, fast-contacts, fast, faithful-capsules or fast-capsules; default: "
        "the physics of the training",
    ),
    "--config": (
        "FILE.yml|NAME",
        f"hyperparameters: a file, or one of {', '.join(NAMED)}; default: the algorithm's preset",
    ),
    "--runs-dir": ("DIR", "folder of all runs; default: runs"),
    "--tree": (
        "NxD",
        "search a tree before each action: N simulations of up to D control steps, such as 64x8; "
        "a third number sets the widening",
    ),
    "--num-threads": (
        "N",
        "torch threads; default: 1, or OMP_NUM_THREADS or MKL_NUM_THREADS",
        whole_number,
    ),
    "--matmul-precision": (
        "HOW",
        "precision of torch's matrix products: highest (default), high or medium; lower ones are "
        "faster on some processors, and less exact on some",
    ),
    "--csv": ("FILE", "write one row per piece to a CSV file", Path),
    "--json": ("FILE", "write all results and statistics to a JSON file", Path),
    "--parts": (
        "NAME|N",
        "part of a MusicXML file to read, by name or number; repeatable",
    ),
    "--no-progress": ("", "hide the progress bar"),
}
"""Metavar, help and type of options shared by several commands."""

Add = Callable[..., None]
Run = Callable[[argparse.Namespace], int]

_Key = TypeVar("_Key")
_Item = TypeVar("_Item")
_Found = TypeVar("_Found")


def add_command(commands: Any, name: str, run: Run, about: str, **options: Any) -> Add:
    """Add a subcommand; return a function that adds its arguments."""
    return command(commands.add_parser(name, help=about), run, **options)


def command(parser: Any, run: Run, *, description: str = "", epilog: str = "") -> Add:
    """Set the parser of a command up; return a function that adds its arguments."""
    parser.set_defaults(command=run)
    parser.description, parser.epilog = description, epilog
    return adder(parser)


class _Several(argparse.Action):
    """Collect the values of all uses of an option; the first use replaces the default."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        earlier = getattr(namespace, self.dest)
        before = () if earlier is self.default else earlier
        setattr(namespace, self.dest, [*before, *values])


def adder(parser: Any) -> Add:
    """Return a function that adds an argument: name, metavar, help, type and default.

    A shared option needs only its name and the values that differ. An option without a metavar is
    a flag; one of several values may also be repeated. The help ends with the default, unless it
    mentions a default itself.
    """

    def add(
        name: str,
        metavar: str = "",
        text: str = "",
        kind: Any = None,
        default: Any = None,
        **more: Any,
    ) -> None:
        shared = _SHARED.get(name, ("", "", None))
        metavar, text = metavar or shared[0], text or shared[1]
        kind = shared[2] if kind is None and len(shared) > 2 else kind
        given = {"metavar": metavar, "help": text, "type": kind, "default": default, **more}
        options = {key: value for key, value in given.items() if value not in ("", None)}
        if default is not None and "default" not in text:
            shown = " ".join(map(str, default)) if isinstance(default, list) else default
            options["help"] = f"{text}; default: {shown}".removeprefix("; ")
        if name.startswith("-") and not {"metavar", "choices"} & options.keys():
            options["action"] = "store_true"
        elif name.startswith("-") and more.get("nargs") == "+":
            options["action"] = _Several
        parser.add_argument(*name.split(), **options)

    return add


def add_piece_arguments(add: Add) -> None:
    """Add the arguments that choose the piece: ``--env``, ``--midi`` and ``--fingering``."""
    add("--env", "ID", "environment id, from 'sb3-piano envs' or another package")
    add("--midi", "FILE", "piece to play: its name, or a file such as MIDI")
    add(
        "--fingering",
        "HOW",
        "finger labels: those of the score (keep, default), missing ones computed (ergonomic), "
        "adapted to the simulated hands (robot), none (optimal-transport), or from a file",
    )


def what_is_played(arguments: argparse.Namespace, instead: str = "") -> tuple[str, dict[str, Any]]:
    """Return the environment id of ``--env`` and ``--midi``, and its settings.

    ``instead`` names the command's other options, for the error if neither is given.
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
    """Parse environment options given as ``--set NAME=VALUE``."""
    from sb3_piano.plain_yaml import parse_yaml

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


def refuse_options(
    arguments: argparse.Namespace, names: Iterable[str], with_what: str, instead: str = ""
) -> None:
    """Raise ConfigError if one of the named options was given.

    The message says that it cannot be given ``with_what``, and what to do ``instead``.
    """
    for name in names:
        value = getattr(arguments, name)
        if value is not None and value is not False:  # 0 is a value
            option = f"--{name.replace('_', '-')}"
            expected = instead or f"Expected no {option}."
            raise ConfigError(f"{option} cannot be given {with_what} {expected}")


def check_output_file(option: str, file: Path | None) -> None:
    """Raise ConfigError if a file cannot be written."""
    if file is None:
        return
    from sb3_piano.files import check_writable

    try:
        check_writable(file)
    except OSError as error:
        raise ConfigError(
            f"{option} is '{file}' ({error.strerror}): expected a file that can be written."
        ) from error


def print_errors(*errors: object) -> int:
    """Print errors to standard error; return the exit status."""
    for error in errors:
        print(f"sb3-piano: error: {error}", file=sys.stderr)
    return EXIT_ERROR if errors else EXIT_OK


def print_interrupted(interrupted: bool, status: int = EXIT_OK, hint: str = ".") -> int:
    """Print a note if Ctrl-C ended the command; return the exit status."""
    if not interrupted:
        return status
    print(f"sb3-piano: interrupted{hint}", file=sys.stderr)
    return EXIT_INTERRUPTED


def new_table(*headings: str, left: int = 1, **options: Any) -> Table:
    """Return an empty table of rich with its first ``left`` columns aligned to the left."""
    from rich.table import Table

    table = Table(**options)
    for index, heading in enumerate(headings):
        table.add_column(heading, justify="left" if index < left else "right", overflow="fold")
    return table


def add_row(table: Table, *cells: str, style: str = "") -> None:
    """Add a row of plain text, without markup."""
    from rich.text import Text

    table.add_row(*(Text(escaped(cell), style=style) for cell in cells))


def print_table(table: Table) -> None:
    """Print a table of rich; without a terminal, at its full width."""
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console.width = max(console.width, _FILE_WIDTH)  # rich assumes 80 columns for a file
    console.print(table)


def print_narrowness(n_values: int) -> None:
    """Print a warning if an interval comes from too few values."""
    if n_values < _FEW_VALUES:
        print(
            f"An interval from so few values ({n_values}) is too narrow: 3 cover the mean in "
            "73 % of cases, 5 in 82 %."
        )


@contextlib.contextmanager
def progress_bar(
    arguments: argparse.Namespace, text: str, columns: Sequence[Any] = ()
) -> Iterator[Callable[..., Any]]:
    """Show a progress bar on a terminal's standard error, unless ``--no-progress`` is given.

    Yields a function with the arguments of ``rich.progress.Progress.update``, such as ``advance``,
    ``completed`` and ``total``. Its first call shows the bar.
    """
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    console = Console(stderr=True)
    if arguments.no_progress or not console.is_terminal:
        yield lambda **changes: None
        return
    shown = (*Progress.get_default_columns(), MofNCompleteColumn(), *columns)
    bar = Progress(*shown, console=console, transient=True)

    def tell(**changes: Any) -> None:
        if not bar.tasks:
            bar.start()  # not before: without a task it would leave an empty line
            bar.add_task(text, total=None, **{k: v for k, v in changes.items() if k == "loss"})
        bar.update(bar.task_ids[0], **changes)

    try:
        yield tell
    finally:
        if bar.tasks:
            bar.stop()


def tracked(arguments: argparse.Namespace, text: str, items: Iterable[_Item]) -> Iterator[_Item]:
    """Yield items and show a progress bar."""
    several = list(items)
    with progress_bar(arguments, text) as tell:
        for done, item in enumerate(several):
            tell(completed=done, total=len(several))
            yield item


def compute_each(
    items: Iterable[tuple[_Key, _Item]],
    compute: Callable[[_Item], _Found | None],
    failures: list[str],
    failed: str = "{error}",
) -> dict[_Key, _Found]:
    """Compute a value for each item; items whose value is ``None`` are left out.

    An error of one item is added to ``failures`` and does not stop the others.
    """
    results = {}
    for name, item in items:
        try:
            result = compute(item)
        except SB3PianoError as error:
            failures.append(failed.format(name=name, error=error))
            continue
        if result is not None:
            results[name] = result
    return results
