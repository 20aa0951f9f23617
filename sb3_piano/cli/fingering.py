"""``sb3-piano pieces fingering``: how far our fingering agrees with labels."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from sb3_piano.cli.common import EXIT_ERROR, EXIT_OK, check_output_file, print_table
from sb3_piano.exceptions import ConfigError, SB3PianoError

if TYPE_CHECKING:
    from sb3_piano.music.fingering import Agreement, MatchRates

_Found = TypeVar("_Found")

_AGREEMENT = ("right", "left", "both", "hands")
_RATES = ("general", "highest", "soft", "recombination")


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    fingering = commands.add_parser(
        "fingering", help="compare our fingering with finger labels, or with those of the PIG data"
    )
    add = fingering.add_argument
    add(
        "pieces",
        nargs="*",
        metavar="NAME",
        help="pieces with finger labels, or a folder of the PIG data set; default: all pieces with "
        "labels that come with the package",
    )
    add("--csv", type=Path, metavar="FILE", help="write a row for each piece")
    add("--no-progress", action="store_true", help="show no progress bar")
    fingering.set_defaults(command=_fingering)


def _fingering(arguments: argparse.Namespace) -> int:
    check_output_file("--csv", arguments.csv)
    folders = [name for name in arguments.pieces if Path(name).is_dir()]
    if folders and len(arguments.pieces) > 1:
        raise ConfigError(
            f"Folder '{folders[0]}' is given with other pieces: expected one folder alone, or "
            "names of pieces."
        )
    failures: list[str] = []
    if folders:
        _judge_folder(folders[0], arguments, failures)
    else:
        _judge_pieces(arguments, failures)
    for failure in failures:
        print(f"sb3-piano: error: {failure}", file=sys.stderr)
    return EXIT_ERROR if failures else EXIT_OK


def _judge_pieces(arguments: argparse.Namespace, failures: list[str]) -> None:
    from sb3_piano.music import BUILT_IN, find_piece
    from sb3_piano.music.fingering import judge

    named = [find_piece(name) for name in arguments.pieces]
    found: dict[str, Agreement] = {}
    for piece in _tracked(named or list(BUILT_IN.values()), arguments):
        try:
            score = piece.score()
            if score.has_fingering or named:
                found[piece.name] = judge(score)
        except SB3PianoError as error:
            failures.append(f"Piece {piece.name!r} was not compared: {error}")
    _show_pieces(found)
    if arguments.csv is not None:
        rows = [_piece_row(name, agreement) for name, agreement in found.items()]
        _write(arguments.csv, ("piece", "notes", *_AGREEMENT), rows)


def _judge_folder(folder: str, arguments: argparse.Namespace, failures: list[str]) -> None:
    from sb3_piano.music.fingering import judge_annotated, pig_files

    found: dict[str, tuple[int, MatchRates]] = {}
    for number, paths in _tracked(pig_files(folder).items(), arguments):
        annotations = _annotations(paths, failures)
        if not annotations:
            continue
        try:
            found[number] = len(annotations), judge_annotated(annotations)
        except SB3PianoError as error:
            failures.append(f"Piece {number} was not compared: {error}")
    _show_folder(found)
    if arguments.csv is not None:
        rows = [
            {"piece": number, "annotators": annotators, "notes": rates.notes}
            | {name: getattr(rates, name) for name in _RATES}
            for number, (annotators, rates) in found.items()
        ]
        _write(arguments.csv, ("piece", "annotators", "notes", *_RATES), rows)


def _annotations(paths: Sequence[Path], failures: list[str]) -> list[Any]:
    from sb3_piano.music import read_pig

    annotations = []
    for path in paths:
        try:
            annotations.append(read_pig(path))
        except SB3PianoError as error:
            failures.append(str(error))
    return annotations


def _tracked(items: Iterable[_Found], arguments: argparse.Namespace) -> Iterable[_Found]:
    from rich.console import Console
    from rich.progress import track

    console = Console(stderr=True)
    hidden = arguments.no_progress or not console.is_terminal
    return track(
        list(items), description="fingering", console=console, transient=True, disable=hidden
    )


def _show_pieces(found: Mapping[str, Agreement]) -> None:
    if not found:
        return
    from rich.table import Table

    table = Table(caption="Shares of labelled notes. Fingers: ours for the labels' hands.")
    for heading in ("piece", "notes", "right", "left", "both", "same hand found"):
        table.add_column(heading, justify="left" if heading == "piece" else "right")
    for name, agreement in found.items():
        shares = [getattr(agreement, share) for share in _AGREEMENT]
        table.add_row(name, str(sum(agreement.notes)), *map(_share, shares))
    table.add_section()
    means = [_mean([getattr(a, share) for a in found.values()]) for share in _AGREEMENT]
    table.add_row(f"mean of {len(found)} pieces", "", *map(_share, means))
    whole = _summed(list(found.values()))
    shares = [getattr(whole, share) for share in _AGREEMENT]
    table.add_row("all notes", str(sum(whole.notes)), *map(_share, shares))
    print_table(table)


def _show_folder(found: Mapping[str, tuple[int, MatchRates]]) -> None:
    if not found:
        return
    from rich.table import Table

    table = Table(caption="Match rates of Nakamura, Saito and Yoshii 2020.")
    for heading in ("piece", "annotators", "notes", *_RATES):
        table.add_column(heading, justify="left" if heading == "piece" else "right")
    for number, (annotators, rates) in found.items():
        shares = [getattr(rates, name) for name in _RATES]
        table.add_row(number, str(annotators), str(rates.notes), *map(_share, shares))
    table.add_section()
    means = [_mean([getattr(rates, name) for _, rates in found.values()]) for name in _RATES]
    notes = sum(rates.notes for _, rates in found.values())
    table.add_row(f"mean of {len(found)}", "", str(notes), *map(_share, means))
    print_table(table)


def _piece_row(name: str, agreement: Agreement) -> dict[str, object]:
    shares = {share: getattr(agreement, share) for share in _AGREEMENT}
    return {"piece": name, "notes": sum(agreement.notes), **shares}


def _summed(agreements: Sequence[Agreement]) -> Agreement:
    from sb3_piano.music.fingering import Agreement

    def total(field: str) -> tuple[int, int]:
        values = [getattr(agreement, field) for agreement in agreements]
        return sum(value[0] for value in values), sum(value[1] for value in values)

    return Agreement(
        notes=total("notes"), same_finger=total("same_finger"), same_hand=total("same_hand")
    )


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f} %"


def _write(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, object]]) -> None:
    from sb3_piano.files import write_csv

    write_csv(path, columns, rows)
    print(f"Pieces: {path}")
