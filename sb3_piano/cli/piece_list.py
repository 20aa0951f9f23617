"""``sb3-piano pieces list``: all pieces in a table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_OK, check_collection, check_output_file, print_table
from sb3_piano.exceptions import SB3PianoError

if TYPE_CHECKING:
    from sb3_piano.music import Piece

Row = Mapping[str, Any]
"""What is known about a piece, by column; None where it is not known."""

_ABOUT = ("name", "title", "collection", "source", "fingering")
_FEATURES = ("duration", "notes", "average_polyphony", "maximum_polyphony", "onset_density")

COLUMNS = (*_ABOUT, *_FEATURES, "difficulty_percentile")
"""The columns of the CSV file, and the keys of the JSON file."""


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    parser = commands.add_parser("list", help="list all pieces, built-in and imported")
    add = parser.add_argument
    add("--collection", metavar="NAME", help="only those of a collection, such as repertoire")
    add("--csv", type=Path, metavar="FILE", help="write a row for each piece")
    add("--json", type=Path, metavar="FILE", help="write the same as JSON")
    parser.set_defaults(command=_list)


def _list(arguments: argparse.Namespace) -> int:
    for option in ("csv", "json"):
        check_output_file(f"--{option}", getattr(arguments, option))
    from sb3_piano.music import pieces

    failures: list[str] = []
    rows = _chosen(_rows(pieces(), failures), arguments.collection)
    _show(rows)
    _write(rows, arguments.csv, arguments.json)
    for failure in failures:
        print(f"sb3-piano: error: {failure}", file=sys.stderr)
    return EXIT_OK


def _rows(pieces: Mapping[str, Piece], failures: list[str]) -> list[Row]:
    from sb3_piano.music.difficulty import rank
    from sb3_piano.music.library import piece_features

    measured = {}
    for name, piece in pieces.items():
        try:
            measured[name] = piece_features(piece)
        except SB3PianoError as error:
            failures.append(str(error))
    places = rank(measured)
    return [
        {
            **{about: getattr(piece, about) for about in _ABOUT},
            **{feature: getattr(measured.get(name), feature, None) for feature in _FEATURES},
            "difficulty_percentile": places[name].percentile if name in places else None,
        }
        for name, piece in pieces.items()
    ]


def _chosen(rows: Sequence[Row], collection: str | None) -> Sequence[Row]:
    """Return the rows of a collection; their percentiles are those among all pieces."""
    if collection is None:
        return rows
    check_collection(collection, (row["collection"] for row in rows))
    return [row for row in rows if row["collection"] == collection]


def _show(rows: Sequence[Row]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table()
    table.add_column("piece", overflow="fold")
    for heading in ("s", "notes", "keys", "notes/s"):
        table.add_column(heading, justify="right")
    table.add_column("fingering")
    table.add_column("%", justify="right")
    for row in rows:
        mean, most = row["average_polyphony"], row["maximum_polyphony"]
        cells = (
            row["name"],
            _cell("{:.1f}", row["duration"]),
            _cell("{:d}", row["notes"]),
            f"{_cell('{:.2f}', mean)} {_cell('{:2d}', most)}",
            _cell("{:.2f}", row["onset_density"]),
            row["fingering"],
            _cell("{:.0f}", row["difficulty_percentile"]),
        )
        table.add_row(*map(Text, cells))
    print_table(table)
    count = "1 piece" if len(rows) == 1 else f"{len(rows)} pieces"
    print(
        f"{count}; keys: pressed at once, mean and most; %: percentile rank of the difficulty "
        "among all, 100 the hardest"
    )


def _cell(form: str, value: float | None) -> str:
    return "-" if value is None else form.format(value)


def _write(rows: Sequence[Row], csv: Path | None, json: Path | None) -> None:
    from sb3_piano.files import write_json
    from sb3_piano.training.csv_files import write_csv

    if csv is not None:
        write_csv(csv, COLUMNS, rows)
        print(f"Table: {csv}")
    if json is not None:
        write_json(json, {"pieces": list(rows)})
        print(f"JSON:  {json}")
