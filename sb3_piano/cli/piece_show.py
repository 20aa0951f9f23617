"""``sb3-piano pieces show``: what is known about a piece, and how it begins."""

from __future__ import annotations

import argparse
import bisect
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_OK, print_table, whole_number
from sb3_piano.exceptions import ScoreError

if TYPE_CHECKING:
    from sb3_piano.music import Note, Piece, Score

_FEW_MOMENTS = 16
"""How many moments are shown of a piece whose bars are not known."""

_HANDS = ("right", "left", None)


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    parser = commands.add_parser("show", help="show what is known about a piece, and its beginning")
    parser.add_argument(
        "name", metavar="NAME|FILE", help="as 'pieces list' shows it, or a file such as MIDI"
    )
    parser.add_argument(
        "--bars", type=whole_number, default=2, metavar="N", help="show so many bars; default: 2"
    )
    parser.set_defaults(command=_show)


def _show(arguments: argparse.Namespace) -> int:
    piece = _piece(arguments.name)
    score = piece.score()
    _tell(piece)
    _print_table("feature", _feature_rows(piece))
    _print_table("option", sorted(piece.options.items()))
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


def _print_table(heading: str, rows: Iterator[tuple[str, str]] | Sequence[tuple[str, str]]) -> None:
    from rich.table import Table
    from rich.text import Text

    listed = list(rows)
    if listed:
        table = Table(heading, "")
        for row in listed:
            table.add_row(*map(Text, row))
        print_table(table)


def _beginning(score: Score, n_bars: int) -> list[list[Note]]:
    """Return the first bars, or the first moments if bars are not known, moment by moment."""
    moments = [list(notes) for _, notes in itertools.groupby(score.notes, lambda n: n.onset)]
    if not score.bars:
        return moments[:_FEW_MOMENTS]
    end = score.bars[n_bars] if n_bars < len(score.bars) else float("inf")
    return [notes for notes in moments if notes[0].onset < end]


def _print_notes(score: Score, moments: Sequence[Sequence[Note]]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table()
    for heading in ("bar", "s"):
        table.add_column(heading, justify="right")
    shown = [hand for hand in _HANDS if any(n.hand == hand for notes in moments for n in notes)]
    for hand in shown:
        table.add_column("no hand" if hand is None else f"{hand} hand")
    for notes in moments:
        onset = notes[0].onset
        bar = bisect.bisect_right(score.bars, onset)
        hands = [" ".join(_spelled(note) for note in notes if note.hand == hand) for hand in shown]
        table.add_row(*map(Text, (str(bar) if score.bars else "-", f"{onset:.2f}", *hands)))
    print_table(table)
    print("Notes: pitch/finger, 1 thumb to 5 little")


def _spelled(note: Note) -> str:
    from sb3_piano.music.hands import finger_number
    from sb3_piano.music.pitch import pitch_name

    name = pitch_name(note.pitch)
    return name if note.finger < 0 else f"{name}/{finger_number(note.finger)}"
