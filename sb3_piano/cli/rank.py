"""``sb3-piano pieces rank``: pieces by difficulty."""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_ERROR,
    EXIT_OK,
    add_row,
    add_shared,
    check_collection,
    check_output_file,
    new_table,
    print_table,
    progress_bar,
)
from sb3_piano.exceptions import ConfigError, SB3PianoError

if TYPE_CHECKING:
    from sb3_piano.music import Piece
    from sb3_piano.music.difficulty import Difficulty, Features, MotionFeatures

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
    ("action_variance", "action var.", "{:.4f}"),
    ("hand_motion", "joints", "{:.4f}"),
    ("fingertip_motion", "tips, mm", "{:.2f}"),
)
_METRES = {"fingertip_motion": 1000.0}  # shown in mm


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    rank = commands.add_parser("rank", help="rank pieces by difficulty, the easiest first")
    add = rank.add_argument
    add("pieces", nargs="*", metavar="NAME", help="rank these among themselves; default: all")
    add("--collection", metavar="NAME", help="only the pieces of a collection, such as repertoire")
    add(
        "--motion",
        nargs="+",
        type=Path,
        default=[],
        metavar="PATH",
        help="recorded performances, which 'evaluate --motion' writes: files, or folders such as "
        "those of runs; pieces without one are left out",
    )
    add_shared(add, "--csv", help="write a row for each piece")
    add_shared(add, "--no-progress")
    rank.set_defaults(command=_rank)


def _rank(arguments: argparse.Namespace) -> int:
    check_output_file("--csv", arguments.csv)
    from sb3_piano.music.difficulty import rank

    failures: list[str] = []
    pieces = _chosen(arguments.pieces, arguments.collection)
    motion = _recorded(arguments.motion, pieces, failures) if arguments.motion else None
    ranked = {name: piece for name, piece in pieces.items() if motion is None or name in motion}
    found = _features(ranked, arguments, failures)
    places = rank(found, motion)
    if places:
        _show(places, found, motion)
    if motion is not None and len(ranked) < len(pieces):
        print(f"{len(pieces) - len(ranked)} of {len(pieces)} pieces have no recorded performance.")
    if arguments.csv is not None:
        _write(arguments.csv, places, found, motion)
    for failure in failures:
        print(f"sb3-piano: error: {failure}", file=sys.stderr)
    return EXIT_ERROR if failures else EXIT_OK


def _chosen(names: Sequence[str], collection: str | None) -> dict[str, Piece]:
    from sb3_piano.music import find_piece, pieces

    chosen = [find_piece(name) for name in names] if names else list(pieces().values())
    if collection is not None:
        check_collection(collection, (piece.collection for piece in chosen))
        chosen = [piece for piece in chosen if piece.collection == collection]
    return {piece.name: piece for piece in chosen}


def _features(
    pieces: Mapping[str, Piece], arguments: argparse.Namespace, failures: list[str]
) -> dict[str, Features]:
    from sb3_piano.music.library import piece_features

    found = {}
    with progress_bar(arguments, "pieces") as tell:
        for done, (name, piece) in enumerate(pieces.items()):
            tell(completed=done, total=len(pieces))
            try:
                found[name] = piece_features(piece)
            except SB3PianoError as error:
                failures.append(f"Piece {name!r} was not ranked: {error}")
    return found


def _recorded(
    paths: Sequence[Path], pieces: Mapping[str, Piece], failures: list[str]
) -> dict[str, MotionFeatures]:
    """Return what moved in the performances of each piece, as a mean over several."""
    from sb3_piano.music.difficulty import mean_motion, read_motion

    by_title = {piece.name.removeprefix(f"{piece.collection}-"): name
                for name, piece in pieces.items()}  # fmt: skip
    found: dict[str, list[MotionFeatures]] = defaultdict(list)
    for path in _files(paths):
        try:
            recording = read_motion(path)
        except SB3PianoError as error:
            failures.append(str(error))
            continue
        name = recording.title if recording.title in pieces else by_title.get(recording.title)
        if name is not None:
            found[name].append(recording.features())
    return {name: mean_motion(several) for name, several in found.items()}


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        files = sorted(path.rglob("performance_*.npz"))
        if not files:
            raise ConfigError(
                f"--motion '{path}' has no recorded performance: expected a folder with files that "
                "'sb3-piano evaluate RUN --motion' wrote."
            )
        yield from files


def _show(
    places: Mapping[str, Difficulty],
    found: Mapping[str, Features],
    motion: Mapping[str, MotionFeatures] | None,
) -> None:
    columns = [*_SCORE_COLUMNS, *(_MOTION_COLUMNS if motion is not None else ())]
    table = new_table("", "piece", "%", *(heading for _, heading, _ in columns), left=0)
    table.columns[1].justify, table.columns[1].min_width = "left", 18
    for name, place in places.items():
        cells = _cells(found[name], _SCORE_COLUMNS)
        if motion is not None:
            cells += _cells(motion[name], _MOTION_COLUMNS)
        add_row(table, str(place.rank), name, f"{place.percentile:.1f}", *cells)
    print_table(table)
    terms = "the score and recorded performances" if motion is not None else "the score alone"
    print(
        f"Difficulty by {terms}, the easiest first; %: percentile rank; keys: pressed at once, "
        "mean and most; span: semitones of a hand; moves/s: semitones that the hands travel"
    )


def _cells(values: Features | MotionFeatures, columns: Sequence[tuple[str, str, str]]) -> list[str]:
    return [form.format(getattr(values, n) * _METRES.get(n, 1)) for n, _, form in columns]


def _write(
    path: Path,
    places: Mapping[str, Difficulty],
    found: Mapping[str, Features],
    motion: Mapping[str, MotionFeatures] | None,
) -> None:
    from sb3_piano.files import write_csv

    rows = [
        {
            "piece": name,
            "rank": place.rank,
            "percentile": place.percentile,
            "score": place.score,
            **{field: getattr(found[name], field) for field, _, _ in _SCORE_COLUMNS},
            "lowest_pitch": found[name].pitch_range[0],
            "highest_pitch": found[name].pitch_range[1],
            **({} if motion is None else _recorded_columns(motion[name])),
        }
        for name, place in places.items()
    ]
    write_csv(path, list(rows[0]) if rows else ["piece"], rows)
    print(f"Pieces: {path}")


def _recorded_columns(motion: MotionFeatures) -> dict[str, float]:
    return {f"recorded_{field}": value for field, value in asdict(motion).items()}
