"""``sb3-piano pieces``: built-in and imported pieces."""

from __future__ import annotations

import argparse
import bisect
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli import rank
from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_OK,
    add_command,
    add_row,
    check_output_file,
    compute_each,
    new_table,
    print_errors,
    print_interrupted,
    print_table,
    progress_bar,
    whole_number,
)
from sb3_piano.cli.rank import in_collection, piece_of
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.text import printable

if TYPE_CHECKING:
    from sb3_piano.music import Note, Piece, Score
    from sb3_piano.music.library.importing import ImportReport
    from sb3_piano.music.library.task import Unusable

_UNITS = {
    "duration": "s",
    "onset_density": "notes/s",
    "average_polyphony": "keys",
    "maximum_polyphony": "keys",
    "hand_span": "semitones",
    "hand_motion": "semitones/s",
}

# Columns of the CSV file, and keys of the JSON file.
_ABOUT = ("name", "title", "collection", "source", "fingering")
_FEATURES = ("duration", "notes", "average_polyphony", "maximum_polyphony", "onset_density")

_FORMS = {
    "name": "{}",
    "duration": "{:.1f}",
    "notes": "{:d}",
    "average_polyphony": "{:.2f}",
    "maximum_polyphony": "{:2d}",
    "onset_density": "{:.2f}",
    "fingering": "{}",
    "difficulty_percentile": "{:.0f}",
}
"""Columns of the table and their formats; mean and maximum polyphony share one column."""

_IMPORT = (
    "Import music into the user's library. Unreadable files are listed; the exit status is 2 only "
    "if no file was imported, now or earlier. Files imported earlier are skipped, so that an "
    "interrupted import can be repeated."
)
_FINGERING_HELP = (
    "finger labels: those of the file (keep), missing ones computed (ergonomic, default), "
    "adapted to the simulated hands (robot), none (optimal-transport), or from another file"
)

_MOST_NAMED = 10
"""Number of pieces named after an import."""

_FEW_MOMENTS = 16
"""Number of onsets shown of a piece without bars."""

_HANDS = ("right", "left", None)


def add_arguments(parser: Any) -> None:
    """Add the subcommands."""
    own = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    add = add_command(own, "list", _list, "list built-in and imported pieces")
    add("--collection", "NAME", "only pieces of this collection, such as repertoire")
    add("--csv")
    add("--json", text="write the table to a JSON file")
    add = add_command(own, "show", _show, "show the facts and the first bars of a piece")
    add("name", "NAME|FILE", "a name from 'pieces list', or a file such as MIDI")
    add("--bars", "N", "number of bars to show", whole_number, 2)
    add("--parts", action="append")
    about = "import files, a folder, the PIG data set, or robopianist's wheel"
    add = add_command(own, "import", _import, about, description=_IMPORT)
    add("path", "PATH", "a MIDI, MusicXML or PIG file, a folder, or a robopianist wheel or folder")
    add("--fingering", "HOW", _FINGERING_HELP)
    add("--name", "NAME", "name of the piece, for a single file; default: the file's")
    add("--parts", action="append")
    add("--jobs", "N", "reading processes; default: one per core", whole_number)
    add("--no-progress")
    add = add_command(own, "remove", _remove, "remove imported pieces without confirmation")
    add("names", "NAME", "a name from 'pieces list'", nargs="+")
    add = add_command(own, "export", _export, "write a piece to a file")
    add("name", "NAME|FILE", "a name from 'pieces list', or a file to convert")
    add("file", "FILE", "output file: MIDI, MusicXML or PIG, by suffix", Path)
    add("--parts", action="append")
    rank.add_parser(own)


def _list(arguments: argparse.Namespace) -> int:
    from sb3_piano.files import write_csv, write_json
    from sb3_piano.music import pieces
    from sb3_piano.music.difficulty import rank
    from sb3_piano.music.library.store import piece_features

    failures: list[str] = []
    measured = compute_each(pieces().items(), piece_features, failures)
    places = rank(measured)  # among all pieces, also those not listed
    rows = [
        {
            **{about: getattr(piece, about) for about in _ABOUT},
            **{feature: getattr(measured.get(name), feature, None) for feature in _FEATURES},
            "difficulty_percentile": places[name].percentile if name in places else None,
        }
        for name, piece in in_collection(pieces(), arguments.collection).items()
    ]
    _print_list(rows)
    if arguments.csv is not None:
        write_csv(arguments.csv, [*_ABOUT, *_FEATURES, "difficulty_percentile"], rows)
        print(f"Table: {arguments.csv}")
    if arguments.json is not None:
        write_json(arguments.json, {"pieces": rows})
        print(f"JSON:  {arguments.json}")
    print_errors(*failures)
    return EXIT_OK


def _print_list(rows: Sequence[Mapping[str, Any]]) -> None:
    table = new_table("piece", "s", "notes", "keys", "notes/s", "fingering", "%")
    table.columns[-2].justify = "left"
    for row in rows:
        cells = {key: "-" if row[key] is None else f.format(row[key]) for key, f in _FORMS.items()}
        cells["average_polyphony"] += f" {cells.pop('maximum_polyphony')}"
        add_row(table, *cells.values())
    print_table(table)
    count = "1 piece" if len(rows) == 1 else f"{len(rows)} pieces"
    print(
        f"{count}; keys: pressed at once, mean and most; %: percentile rank of the difficulty "
        "among all, 100 the hardest"
    )


def _show(arguments: argparse.Namespace) -> int:
    from sb3_piano.music.library.store import piece_features

    piece = piece_of(arguments.name, arguments.parts or ())
    score = piece.score()
    _print_facts(piece, score)
    try:
        measured = asdict(piece_features(piece))
    except ScoreError as error:
        measured = {"none": str(error)}
    features = {name.replace("_", " "): _short(name, value) for name, value in measured.items()}
    for heading, pairs in (("feature", features), ("option", dict(sorted(piece.options.items())))):
        table = new_table(heading, "", left=2)
        for name, text in pairs.items():
            add_row(table, name, text)
        if pairs:
            print_table(table)
    _print_notes(score, _beginning(score, arguments.bars))
    return EXIT_OK


def _short(name: str, value: Any) -> str:
    from sb3_piano.music.pitch import pitch_name

    if name == "pitch_range":
        return " to ".join(map(pitch_name, value))
    text = f"{value:.4g}" if isinstance(value, float) else str(value)
    return f"{text} {_UNITS.get(name, '')}".rstrip()


def _print_facts(piece: Piece, score: Score) -> None:
    import gymnasium

    from sb3_piano.music.library import Library
    from sb3_piano.registration import GENERAL_ID

    env_id, library = f"RoboPianist-{piece.name}-v0", Library()
    general = f'{GENERAL_ID} with score="{piece.name}"'
    facts = {
        "Name": piece.name,
        "Id": env_id if env_id in gymnasium.registry else general,
        "Collection": piece.collection,
        "Source": piece.source,
        "Fingering": piece.fingering if score.has_fingering else "none",
    }
    if piece.name in library:
        info = library.info(piece.name)
        facts["Kept in"] = str(library.path(piece.name))
        facts["From"] = info.path or "elsewhere"
        facts["SHA-256"] = info.sha256 or "unknown"
    print(printable(piece.title))
    for name, text in facts.items():
        print(f"{name + ':':<11} {printable(text)}")


def _beginning(score: Score, n_bars: int) -> list[list[Note]]:
    """Return the notes of the first bars by onset; without bars, of the first onsets."""
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


def _import(arguments: argparse.Namespace) -> int:
    from sb3_piano.music.library import Library, import_path

    with progress_bar(arguments, "pieces") as tell:
        report = import_path(
            arguments.path,
            fingering=arguments.fingering,
            name=arguments.name,
            parts=arguments.parts or (),
            jobs=arguments.jobs,
            progress=lambda done, total: tell(completed=done, total=total),
        )
    _print_imported(report)
    print(f"Library: {Library().folder}")
    status = EXIT_OK if report.imported or report.present else EXIT_ERROR
    hint = "; the same command imports the rest."
    return print_interrupted(report.interrupted, status, hint)


def _print_imported(report: ImportReport) -> None:
    for note in report.notes:
        print(f"Note: {_reason(note)}")
    for unusable in report.unusable:
        print(f"Not imported: {_reason(unusable)}", file=sys.stderr)
    if report.imported:
        print(f"Imported: {_names(report.imported)}")
    if report.present:
        print(f"There already: {_names(report.present)}")
    if report.copies:
        print(f"Copies of other files: {report.copies}")
    if report.unusable:
        print(f"Not imported: {len(report.unusable)}, as listed")


def _reason(file: Unusable) -> str:
    """Return the reason why a file is unusable, with its name once."""
    named = str(file.path) in file.reason
    return file.reason if named else f"{file.path}: {file.reason}"


def _names(names: Sequence[str]) -> str:
    if len(names) <= _MOST_NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:_MOST_NAMED])} and {len(names) - _MOST_NAMED} more"


def _remove(arguments: argparse.Namespace) -> int:
    from sb3_piano.exceptions import near_names
    from sb3_piano.music import BUILT_IN
    from sb3_piano.music.library import Library

    library = Library()
    for name in arguments.names:  # check all before removing the first
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
    from sb3_piano.music.formats import write_score

    write_score(piece_of(arguments.name, arguments.parts or ()).score(), arguments.file)
    print(f"Exported: {arguments.file}")
    return EXIT_OK
