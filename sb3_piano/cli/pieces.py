"""``sb3-piano pieces``: the pieces that come with the package, and the user's own."""

from __future__ import annotations

import argparse
import bisect
import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli import fingering, piece_import, rank
from sb3_piano.cli.common import (
    EXIT_OK,
    add_row,
    add_shared,
    check_collection,
    check_output_file,
    new_table,
    print_table,
    whole_number,
)
from sb3_piano.exceptions import ConfigError, SB3PianoError, ScoreError, UnknownPieceError

if TYPE_CHECKING:
    from sb3_piano.music import Note, Piece, Score

_ABOUT = ("name", "title", "collection", "source", "fingering")
_FEATURES = ("duration", "notes", "average_polyphony", "maximum_polyphony", "onset_density")
_COLUMNS = (*_ABOUT, *_FEATURES, "difficulty_percentile")
"""The columns of the CSV file, and the keys of the JSON file."""

_FEW_MOMENTS = 16
"""Number of moments shown of a piece whose bars are not known."""

_HANDS = ("right", "left", None)

Row = Mapping[str, Any]
"""Facts about a piece, by column; None where not known."""


def add_parser(commands: Any) -> None:
    """Add the command with its own commands; the longer ones have a module each."""
    pieces = commands.add_parser("pieces", help="import, list, show, rank and export pieces")
    own = pieces.add_subparsers(title="commands", required=True, metavar="COMMAND")
    parser = own.add_parser("list", help="list all pieces, built-in and imported")
    collection_help = "only those of a collection, such as repertoire"
    parser.add_argument("--collection", metavar="NAME", help=collection_help)
    add_shared(parser.add_argument, "--csv", help="write a row for each piece")
    add_shared(parser.add_argument, "--json", help="write the same as JSON")
    parser.set_defaults(command=_list)
    parser = own.add_parser("show", help="show what is known about a piece, and its beginning")
    name_help = "as 'pieces list' shows it, or a file such as MIDI"
    parser.add_argument("name", metavar="NAME|FILE", help=name_help)
    parser.add_argument(
        "--bars", type=whole_number, default=2, metavar="N", help="show so many bars; default: 2"
    )
    parser.set_defaults(command=_show)
    piece_import.add_parser(own)
    remove = own.add_parser("remove", help="remove imported pieces, without asking")
    remove.add_argument("names", nargs="+", metavar="NAME", help="as 'pieces list' shows it")
    remove.set_defaults(command=_remove)
    export = own.add_parser("export", help="write a piece to a file")
    export.add_argument("name", metavar="NAME", help="as 'pieces list' shows it")
    export.add_argument("file", type=Path, metavar="FILE", help="MIDI, MusicXML or PIG, by suffix")
    export.set_defaults(command=_export)
    for module in (rank, fingering):
        module.add_parser(own)


def _list(arguments: argparse.Namespace) -> int:
    for option in ("csv", "json"):
        check_output_file(f"--{option}", getattr(arguments, option))
    from sb3_piano.files import write_csv, write_json
    from sb3_piano.music import pieces

    failures: list[str] = []
    rows = _rows(pieces(), failures)
    if arguments.collection is not None:  # percentiles are those among all pieces
        check_collection(arguments.collection, (row["collection"] for row in rows))
        rows = [row for row in rows if row["collection"] == arguments.collection]
    _print_list(rows)
    if arguments.csv is not None:
        write_csv(arguments.csv, _COLUMNS, rows)
        print(f"Table: {arguments.csv}")
    if arguments.json is not None:
        write_json(arguments.json, {"pieces": rows})
        print(f"JSON:  {arguments.json}")
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


def _print_list(rows: Sequence[Row]) -> None:
    table = new_table("piece", "s", "notes", "keys", "notes/s", "fingering", "%")
    table.columns[-2].justify = "left"
    for row in rows:
        mean, most = row["average_polyphony"], row["maximum_polyphony"]
        add_row(
            table,
            row["name"],
            _cell("{:.1f}", row["duration"]),
            _cell("{:d}", row["notes"]),
            f"{_cell('{:.2f}', mean)} {_cell('{:2d}', most)}",
            _cell("{:.2f}", row["onset_density"]),
            row["fingering"],
            _cell("{:.0f}", row["difficulty_percentile"]),
        )
    print_table(table)
    count = "1 piece" if len(rows) == 1 else f"{len(rows)} pieces"
    print(
        f"{count}; keys: pressed at once, mean and most; %: percentile rank of the difficulty "
        "among all, 100 the hardest"
    )


def _cell(form: str, value: float | None) -> str:
    return "-" if value is None else form.format(value)


def _show(arguments: argparse.Namespace) -> int:
    piece = _piece(arguments.name)
    score = piece.score()
    _tell(piece)
    _print_pairs("feature", _feature_rows(piece))
    _print_pairs("option", sorted(piece.options.items()))
    _print_notes(score, _beginning(score, arguments.bars))
    return EXIT_OK


def _piece(text: str) -> Piece:
    """Return the piece of a name, or a file as one."""
    from sb3_piano.music import Piece, find_piece, is_path, load_score

    if not is_path(text):
        return find_piece(text)
    score = load_score(text)
    return Piece(
        name=text,
        title=score.title,
        collection="none",
        source=text,
        fingering="as in the file",
        build=lambda: score,
    )


def _tell(piece: Piece) -> None:
    import gymnasium

    from sb3_piano.envs.registration import GENERAL_ID
    from sb3_piano.music.library import user_library

    print(f"{piece.title}")
    print(f"Name:       {piece.name}")
    env_id = f"RoboPianist-{piece.name}-v0"
    general = f'{GENERAL_ID} with score="{piece.name}"'
    print(f"Id:         {env_id if env_id in gymnasium.registry else general}")
    print(f"Collection: {piece.collection}")
    print(f"Source:     {piece.source}")
    print(f"Fingering:  {piece.fingering}")
    library = user_library()
    if piece.name in library:
        info = library.info(piece.name)
        print(f"Kept in:    {library.path(piece.name)}")
        print(f"From:       {info.path or 'elsewhere'}")
        print(f"SHA-256:    {info.sha256 or 'unknown'}")


def _feature_rows(piece: Piece) -> Iterator[tuple[str, str]]:
    from sb3_piano.music.library import piece_features

    try:
        measured = asdict(piece_features(piece))
    except ScoreError as error:
        yield "none", str(error)
        return
    for name, value in measured.items():
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        yield name.replace("_", " "), text


def _print_pairs(heading: str, rows: Iterable[tuple[str, str]]) -> None:
    table = new_table(heading, "", left=2)
    for row in rows:
        add_row(table, *row)
    if table.rows:
        print_table(table)


def _beginning(score: Score, n_bars: int) -> list[list[Note]]:
    """Return the first bars, or the first moments if bars are not known, moment by moment."""
    moments = [list(notes) for _, notes in itertools.groupby(score.notes, lambda n: n.onset)]
    if not score.bars:
        return moments[:_FEW_MOMENTS]
    end = score.bars[n_bars] if n_bars < len(score.bars) else float("inf")
    return [notes for notes in moments if notes[0].onset < end]


def _print_notes(score: Score, moments: Sequence[Sequence[Note]]) -> None:
    shown = [hand for hand in _HANDS if any(n.hand == hand for notes in moments for n in notes)]
    table = new_table("bar", "s", left=0)
    for hand in shown:
        table.add_column("no hand" if hand is None else f"{hand} hand")
    for notes in moments:
        onset = notes[0].onset
        bar = bisect.bisect_right(score.bars, onset)
        hands = [" ".join(_spelled(note) for note in notes if note.hand == hand) for hand in shown]
        add_row(table, str(bar) if score.bars else "-", f"{onset:.2f}", *hands)
    print_table(table)
    print("Notes: pitch/finger, 1 thumb to 5 little")


def _spelled(note: Note) -> str:
    from sb3_piano.music.hands import finger_number
    from sb3_piano.music.pitch import pitch_name

    name = pitch_name(note.pitch)
    return name if note.finger < 0 else f"{name}/{finger_number(note.finger)}"


def _remove(arguments: argparse.Namespace) -> int:
    from sb3_piano.exceptions import near_names
    from sb3_piano.music import BUILT_IN
    from sb3_piano.music.library import user_library

    library = user_library()
    for name in arguments.names:  # all of them before the first is gone
        if name in BUILT_IN:
            raise ConfigError(
                f"Piece {name!r} comes with the package: expected pieces that were imported."
            )
        if name not in library:
            raise UnknownPieceError(
                f"No imported piece is named {name!r}.{near_names(name, library.names())} Expected "
                "a name from 'sb3-piano pieces list'."
            )
    for name in dict.fromkeys(arguments.names):
        library.remove(name)
        print(f"Removed: {name}")
    return EXIT_OK


def _export(arguments: argparse.Namespace) -> int:
    check_output_file("FILE", arguments.file)
    from sb3_piano.music import find_piece
    from sb3_piano.music.formats import write_score

    write_score(find_piece(arguments.name).score(), arguments.file)
    print(f"Exported: {arguments.file}")
    return EXIT_OK
