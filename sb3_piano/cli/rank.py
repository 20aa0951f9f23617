"""``sb3-piano pieces rank`` and ``fingering``: difficulty of pieces, agreement of fingerings."""

from __future__ import annotations

import argparse
import functools
import os
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    add_command,
    add_row,
    compute_each,
    new_table,
    print_errors,
    print_table,
    tracked,
)
from sb3_piano.exceptions import ConfigError
from sb3_piano.text import printable

if TYPE_CHECKING:
    from rich.table import Table

    from sb3_piano.music import Piece
    from sb3_piano.music.difficulty import MotionFeatures

_Row = dict[str, Any]

_NO_COLLECTION = "none"
"""Collection of a piece from a file."""

# Key of a row, heading, form.
_SCORE_COLUMNS = (
    ("notes", "notes", "{:d}"),
    ("duration", "s", "{:.1f}"),
    ("average_polyphony", "keys", "{:.2f}"),
    ("maximum_polyphony", "most", "{:d}"),
    ("onset_density", "notes/s", "{:.2f}"),
    ("hand_span", "span", "{:d}"),
    ("hand_motion", "moves/s", "{:.2f}"),
)
_MOTION_COLUMNS = (
    ("recorded_action_variance", "action var.", "{:.4f}"),
    ("recorded_hand_motion", "joints", "{:.4f}"),
    ("recorded_fingertip_motion", "tips, mm", "{:.2f}"),
)
_SCALES = {"recorded_fingertip_motion": 1000.0}  # shown in mm

_AGREEMENT = ("right", "left", "both", "hands")
_RATES = ("general", "highest", "soft", "recombination")

_MOTION_HELP = (
    "use recorded motion in the ranking: files of 'evaluate --motion', or folders such as runs; "
    "pieces without a recording are left out"
)
_LABELLED_HELP = (
    "pieces or files with finger labels, or a folder of the PIG data set; default: all built-in "
    "pieces with labels"
)


def add_parser(commands: Any) -> None:
    """Add the commands ``rank`` and ``fingering``."""
    add = add_command(commands, "rank", _rank, "rank pieces by difficulty, the easiest first")
    about = "pieces to rank; default: all pieces"
    add("pieces", "NAME|FILE", about, nargs="*")
    add("--collection", "NAME", "only pieces of this collection, such as repertoire")
    add("--motion", "PATH", _MOTION_HELP, Path, nargs="+")
    add("--csv")
    add("--no-progress")
    about = "compare the computed fingering with finger labels of pieces or of the PIG data set"
    add = add_command(commands, "fingering", _fingering, about)
    add("pieces", "NAME|FILE", _LABELLED_HELP, nargs="*")
    add("--csv")
    add("--no-progress")


def in_collection(pieces: Mapping[str, Piece], collection: str | None) -> dict[str, Piece]:
    """Return the pieces of a known collection; without a name, all pieces."""
    from sb3_piano.music.catalogue import of_collection
    from sb3_piano.settings import refuse_unknown

    if collection is None:
        return dict(pieces)
    known = sorted({"imported", *(piece.collection for piece in pieces.values())})
    refuse_unknown([collection], known, "collection")
    return {name: pieces[name] for name in of_collection(pieces, collection)}


def piece_of(text: str, parts: Sequence[str] = ()) -> Piece:
    """Return a piece by name or file; a file is read when its score is needed."""
    from sb3_piano.music import Piece, find_piece, load_score
    from sb3_piano.music.catalogue import is_path

    if not (parts or is_path(text)):
        return find_piece(text)
    return Piece(
        name=text,
        title=printable(Path(text).stem),
        collection=_NO_COLLECTION,
        source=text,
        fingering="as in the file",
        build=functools.cache(lambda: load_score(text, parts)),
    )


def _rank(arguments: argparse.Namespace) -> int:
    from sb3_piano.music import pieces
    from sb3_piano.music.difficulty import rank
    from sb3_piano.music.library.store import piece_features

    failures: list[str] = []
    named = {piece.name: piece for piece in map(piece_of, arguments.pieces)}
    chosen = in_collection(named or pieces(), arguments.collection)
    motion = _recorded(arguments.motion, chosen, failures) if arguments.motion else None
    ranked = {name: piece for name, piece in chosen.items() if motion is None or name in motion}
    bar = tracked(arguments, "pieces", ranked.items())
    found = compute_each(bar, piece_features, failures, "Piece {name!r} was not ranked: {error}")
    rows = [
        {
            "piece": name,
            "rank": place.rank,
            "percentile": place.percentile,
            "score": place.score,
            **{field: getattr(found[name], field) for field, _, _ in _SCORE_COLUMNS},
            "lowest_pitch": found[name].pitch_range[0],
            "highest_pitch": found[name].pitch_range[1],
            **{f"recorded_{f}": v for f, v in (asdict(motion[name]) if motion else {}).items()},
        }
        for name, place in rank(found, motion).items()
    ]
    if rows:
        _show_ranks(rows, with_motion=motion is not None)
    if len(ranked) < len(chosen):
        print(f"{len(chosen) - len(ranked)} of {len(chosen)} pieces have no recorded performance.")
    _write(arguments.csv, list(rows[0]) if rows else ["piece"], rows)
    return print_errors(*failures)


def _recorded(
    paths: Sequence[Path], pieces: Mapping[str, Piece], failures: list[str]
) -> dict[str, MotionFeatures]:
    """Return the mean motion features of each piece's recorded performances."""
    from sb3_piano.music.difficulty import mean_motion
    from sb3_piano.take import Take

    by_title = {
        p.title if p.collection == _NO_COLLECTION else p.name.removeprefix(f"{p.collection}-"): name
        for name, p in pieces.items()
    }
    found: dict[str, list[MotionFeatures]] = defaultdict(list)
    files = ((path, path) for path in _motion_files(paths))
    for recording in compute_each(files, Take.read, failures).values():
        name = recording.title if recording.title in pieces else by_title.get(recording.title)
        if name is not None and recording.motion is not None:
            found[name].append(recording.motion.features())
    return {name: mean_motion(several) for name, several in found.items()}


def _motion_files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        files = sorted(path.rglob("performance*.npz")) if os.path.isdir(path) else [path]
        if not files:
            raise ConfigError(
                f"--motion '{path}' has no recorded performance: expected a folder with files that "
                "'sb3-piano evaluate RUN --motion' wrote."
            )
        yield from files


def _show_ranks(rows: Sequence[_Row], *, with_motion: bool) -> None:
    columns = [*_SCORE_COLUMNS, *(_MOTION_COLUMNS if with_motion else ())]
    table = new_table("", "piece", "%", *(heading for _, heading, _ in columns), left=0)
    table.columns[1].justify, table.columns[1].min_width = "left", 18
    for row in rows:
        cells = [form.format(row[key] * _SCALES.get(key, 1)) for key, _, form in columns]
        add_row(table, str(row["rank"]), row["piece"], f"{row['percentile']:.1f}", *cells)
    print_table(table)
    terms = "the score and recorded performances" if with_motion else "the score alone"
    print(
        f"Difficulty by {terms}, the easiest first; %: percentile rank; keys: pressed at once, "
        "mean and most; span: semitones of a hand; moves/s: semitones that the hands travel"
    )


def _fingering(arguments: argparse.Namespace) -> int:
    folders = [name for name in arguments.pieces if os.path.isdir(name)]
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
    return print_errors(*failures)


def _judge_pieces(arguments: argparse.Namespace, failures: list[str]) -> None:
    from sb3_piano.music import BUILT_IN
    from sb3_piano.music.fingering import Agreement
    from sb3_piano.music.fingering.agreement import judge

    named = [piece_of(name) for name in arguments.pieces]

    def judged(piece: Piece) -> Agreement | None:
        score = piece.score()
        return judge(score) if score.has_fingering or named else None

    def row(name: str, agreement: Agreement) -> _Row:
        shares = {share: getattr(agreement, share) for share in _AGREEMENT}
        return {"piece": name, "notes": sum(agreement.notes), **shares}

    pieces = {piece.name: piece for piece in named or BUILT_IN.values()}
    bar = tracked(arguments, "fingering", pieces.items())
    found = compute_each(bar, judged, failures, "Piece {name!r} was not compared: {error}")
    rows = [row(name, agreement) for name, agreement in found.items()]
    if rows:
        counts: dict[str, Any] = {
            field: tuple(map(sum, zip(*(getattr(a, field) for a in found.values()), strict=True)))
            for field in ("notes", "same_finger", "same_hand")
        }
        below = _means(f"mean of {len(rows)} pieces", rows), row("all notes", Agreement(**counts))
        caption = "Shares of labelled notes. Fingers: ours for the labels' hands."
        headings = ("piece", "notes", "right", "left", "both", "same hand found")
        _show_shares(new_table(*headings, caption=caption), rows, *below)
    _write(arguments.csv, ("piece", "notes", *_AGREEMENT), rows)


def _judge_folder(folder: str, arguments: argparse.Namespace, failures: list[str]) -> None:
    from sb3_piano.music.fingering.agreement import judge_annotated, pig_files
    from sb3_piano.music.formats.pig import read_pig

    def judged(paths: Sequence[Path]) -> _Row | None:
        annotations = compute_each(((path, path) for path in paths), read_pig, failures)
        if not annotations:
            return None
        rates = judge_annotated(list(annotations.values()))
        shares = {name: getattr(rates, name) for name in _RATES}
        return {"annotators": len(annotations), "notes": rates.notes, **shares}

    bar = tracked(arguments, "fingering", pig_files(folder).items())
    found = compute_each(bar, judged, failures, "Piece {name} was not compared: {error}")
    rows = [{"piece": number, **row} for number, row in found.items()]
    columns = ("piece", "annotators", "notes", *_RATES)
    if rows:
        means = _means(f"mean of {len(rows)}", rows) | {"notes": sum(row["notes"] for row in rows)}
        caption = "Match rates of Nakamura, Saito and Yoshii 2020."
        _show_shares(new_table(*columns, caption=caption), rows, means)
    _write(arguments.csv, columns, rows)


def _means(name: str, rows: Sequence[_Row]) -> _Row:
    """Return the mean of each share over the rows that have it; counts stay empty."""
    means: _Row = {"piece": name}
    for key in [key for key in rows[0] if key != "piece"]:
        known = [row[key] for row in rows if row[key] is not None]
        means[key] = "" if key in ("notes", "annotators") else fmean(known) if known else None
    return means


def _show_shares(table: Table, rows: Sequence[_Row], *below: _Row) -> None:
    for index, row in enumerate([*rows, *below]):
        if index == len(rows):
            table.add_section()
        add_row(table, *map(_cell, row.values()))
    print_table(table)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{100 * value:.1f} %"
    return "-" if value is None else str(value)


def _write(file: Path | None, columns: Sequence[str], rows: Sequence[_Row]) -> None:
    from sb3_piano.files import write_csv

    if file is not None:
        write_csv(file, columns, rows)
        print(f"Pieces: {file}")
