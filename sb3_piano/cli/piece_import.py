"""``sb3-piano pieces import``: the user's music, made pieces."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_ERROR, EXIT_INTERRUPTED, EXIT_OK, whole_number

if TYPE_CHECKING:
    from sb3_piano.music.library import ImportReport, Unusable

_MOST_NAMED = 10


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    parser = commands.add_parser(
        "import",
        help="import a file, a folder, the PIG data set, or a wheel or folder of robopianist",
        description="Import music into the user's library. Files that cannot be read are listed; "
        "the status is 2 only if nothing was imported and nothing was there before. What was "
        "imported earlier is not imported again, so that an import can be interrupted.",
    )
    add = parser.add_argument
    add("path", metavar="PATH", help="MIDI, MusicXML, PIG text, a folder, or a robopianist wheel")
    add(
        "--fingering",
        metavar="HOW",
        help="ergonomic (default): find fingers for notes that have none; robot: those that "
        "suit the simulated hands; keep: only those in the file; optimal-transport: none, any "
        "finger will do; or a file with labels",
    )
    add("--name", metavar="NAME", help="the piece's name, for a single file; default: the file's")
    add(
        "--jobs",
        type=whole_number,
        metavar="N",
        help="read in so many processes; default: one for each core",
    )
    add("--no-progress", action="store_true", help="show no progress bar")
    parser.set_defaults(command=_import)


def _import(arguments: argparse.Namespace) -> int:
    from tqdm import tqdm

    from sb3_piano.music.library import import_path, user_library

    # None hides the bar where there is no terminal.
    with tqdm(unit=" pieces", disable=True if arguments.no_progress else None) as bar:

        def show(n_done: int, n_all: int) -> None:
            bar.total = n_all
            bar.update(n_done - bar.n)

        report = import_path(
            arguments.path,
            fingering=arguments.fingering,
            name=arguments.name,
            jobs=arguments.jobs,
            progress=show,
        )
    _tell(report)
    print(f"Library: {user_library().folder}")
    if report.interrupted:
        print("sb3-piano: interrupted; the same command goes on with the rest.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_OK if report.imported or report.present else EXIT_ERROR


def _tell(report: ImportReport) -> None:
    for note in report.notes:
        print(f"Note: {_told(note)}")
    for unusable in report.unusable:
        print(f"Not imported: {_told(unusable)}", file=sys.stderr)
    if report.imported:
        print(f"Imported: {_names(report.imported)}")
    if report.present:
        print(f"There already: {_names(report.present)}")
    if report.unusable:
        print(f"Not imported: {len(report.unusable)}, as listed")


def _told(file: Unusable) -> str:
    """Return what is odd about a file, with its name once."""
    named = str(file.path) in file.reason
    return file.reason if named else f"{file.path}: {file.reason}"


def _names(names: Sequence[str]) -> str:
    if len(names) <= _MOST_NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:_MOST_NAMED])} and {len(names) - _MOST_NAMED} more"
