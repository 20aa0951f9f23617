"""Read finger labels from a file, and put them on the notes of a score.

Labels from an annotator, or from a program that watches a video, replace our fingering. Besides
the formats of scores, a plain table can be read: a CSV file in UTF-8 whose first line names its
columns: ``onset`` (s), ``pitch`` (a MIDI number or a name such as ``Eb4``), ``finger``, and
optionally ``hand`` (``right`` or ``left``)::

    onset,pitch,hand,finger
    0.0,C5,right,1
    0.5,D5,right,2

With a hand, fingers are the pianists' 1 (thumb) to 5 (little). Without one, they are 0 to 4 for the
right hand and 5 to 9 for the left one, as in `Note`. An empty finger is unknown. Other columns are
ignored.
"""

from __future__ import annotations

import bisect
import csv
import dataclasses
import functools
import io
import math
import os
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import FINGERS_PER_HAND, NUM_FINGERS, UNKNOWN_FINGER
from sb3_piano.music.formats import read_score
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.note import Note, located_note
from sb3_piano.music.pitch import pitch_name, pitch_number
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import read_field, read_text, read_whole

TOLERANCE = 0.05
"""Default largest distance of a label's onset from its note's, in s; as in mir_eval, for comparing
transcriptions."""

SAME_ONSET = 1e-3
"""Largest distance of equal onsets, in s: formats round times, MIDI to 0.1 ms."""

_FRACTION = re.compile(r"\.0+$")
_LABEL_LENGTH = 0.1  # s; a table has no offsets, and none are used


def read_labels(
    path: str | os.PathLike[str], score: Score, *, tolerance: float = TOLERANCE
) -> Score:
    """Apply the fingers and hands of a file to the notes of a score.

    A label belongs to the note of its pitch with the nearest onset; labels and notes are paired
    one to one. A label with a hand alone keeps the note's finger if it belongs to that hand. Notes
    without a label stay unchanged.

    Args:
        path: A file in a format of :func:`~sb3_piano.music.formats.read_score`, in which notes have
            fingers or hands, or a ``.csv`` table as above.
        score: The score to label.
        tolerance: Largest distance of a label's onset from its note's, in s, at least 0.

    Raises:
        ScoreError: If the tolerance is out of range, the file cannot be read or has no labels, or
            fewer than half of its labels match a note.
    """
    path = Path(path)
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise ScoreError(f"A tolerance of {tolerance} s is out of range: expected 0 or more.")
    source = _read_table(path) if path.suffix.lower() == ".csv" else read_score(path)
    labelled = [note for note in source.notes if note.hand is not None]
    if not labelled:
        raise ScoreError(
            f"None of the {len(source.notes)} notes of {str(path)!r} has a finger or a hand: "
            "expected a file with labels."
        )
    labels = Score(notes=labelled, title=str(path))
    pairs = pair_notes(labels.notes, score.notes, tolerance)
    if 2 * len(pairs) < len(labels.notes):
        first = next(index for index in range(len(labels.notes)) if index not in pairs)
        raise ScoreError(
            f"Only {len(pairs)} of {len(labels.notes)} labels of {labels.title!r} find a note of "
            f"{score.title!r} within {tolerance:g} s; the first that does not is that of "
            f"{_describe(first, labels)}. Expected labels of the same piece at the same tempo."
        )
    notes = list(score.notes)
    for place, index in pairs.items():
        label, note = labels.notes[place], notes[index]
        if label.finger != UNKNOWN_FINGER or label.hand != note.hand:
            notes[index] = dataclasses.replace(note, finger=label.finger, hand=label.hand)
    return dataclasses.replace(score, notes=tuple(notes))


def _read_table(path: Path) -> Score:
    text = io.StringIO(read_text(path, "table of labels"), newline="")
    rows = csv.DictReader(text, restval="", skipinitialspace=True)
    try:
        rows.fieldnames = _checked_columns(rows.fieldnames or (), path)
        notes = [_read_row(f"Line {rows.line_num} of {str(path)!r}", row) for row in rows]
    except csv.Error as error:
        raise ScoreError(
            f"Line {rows.line_num} of {str(path)!r} is no row of a table: {error}. Expected CSV."
        ) from error
    if not notes:
        raise ScoreError(f"Table {str(path)!r} has no labels: expected lines below its first one.")
    return Score(notes=notes, title=path.stem)


def _checked_columns(names: Iterable[str], path: Path) -> list[str]:
    columns = [name.strip().lower() for name in names]
    for name in ("onset", "pitch", "finger"):
        if name not in columns:
            raise ScoreError(
                f"Table {str(path)!r} has no column {name!r}: expected a first line that names "
                "onset, pitch, finger and perhaps hand."
            )
    return columns


def _read_row(where: str, row: Mapping[str | None, str]) -> Note:
    # csv puts fields beyond the last column under None.
    texts = {name: value.strip() for name, value in row.items() if name is not None}
    for name in ("pitch", "finger"):  # pandas writes 60.0 in a column with gaps
        texts[name] = _FRACTION.sub("", texts[name])
    read = functools.partial(read_field, where)
    onset = read("onset", texts["onset"], float, "seconds, such as 1.25")
    pitches = "a MIDI number such as 60, or a name such as C4, F#5 or Bb3"
    pitch = read("pitch", texts["pitch"], _pitch, pitches)
    sides: tuple[Hand | None, ...] = (None, *HANDS)
    side = read("hand", texts.get("hand", "").lower(), ("", *HANDS).index, "right, left or nothing")
    fingers, expected = range(NUM_FINGERS), "0-4 (right) or 5-9 (left), or a column 'hand'"
    if hand := sides[side]:
        fingers, expected = range(1, FINGERS_PER_HAND + 1), "1 (thumb) to 5 (little)"
    finger = UNKNOWN_FINGER
    if texts["finger"].lower() not in ("", "-1", "nan"):
        numbers: list[int | None] = [*fingers]
        place = read("finger", texts["finger"], lambda t: numbers.index(read_whole(t)), expected)
        finger = place + FINGERS_PER_HAND * (hand == "left")
    offset = onset + _LABEL_LENGTH
    return located_note(where, onset=onset, offset=offset, pitch=pitch, finger=finger, hand=hand)


def _pitch(text: str) -> int:
    number = read_whole(text)
    return pitch_number(text) if number is None else number


def pair_notes(
    notes: Sequence[Note], others: Sequence[Note], tolerance: float = SAME_ONSET
) -> dict[int, int]:
    """Pair notes of equal pitch and close onsets one to one.

    The nearest pairs are made first; among equally near ones, the earlier. Onsets of a pair are at
    most ``tolerance`` (s) apart; ``others`` are sorted by onset.

    Returns:
        For each paired note's index, the index of the other note.
    """
    by_pitch: dict[int, list[int]] = defaultdict(list)
    for index, other in enumerate(others):
        by_pitch[other.pitch].append(index)
    near: list[tuple[float, int, int]] = []
    for index, note in enumerate(notes):
        same_pitch = by_pitch[note.pitch]
        # Compare distances, as a sum would be rounded differently.
        low = bisect.bisect_left(
            same_pitch, -tolerance, key=lambda at: others[at].onset - note.onset
        )
        for place in same_pitch[low:]:
            distance = others[place].onset - note.onset
            if distance > tolerance:
                break
            near.append((abs(distance), index, place))
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, index, place in sorted(near):
        if index not in pairs and place not in taken:
            pairs[index] = place
            taken.add(place)
    return pairs


def pair_all(score: Score, other: Score) -> dict[int, int]:
    """Pair every note of a score with the same note of another score.

    Raises:
        ScoreError: If `other` lacks a note of the score.
    """
    pairs = pair_notes(score.notes, other.notes)
    missing = [index for index in range(len(score.notes)) if index not in pairs]
    if missing:
        raise ScoreError(
            f"{len(missing)} of {len(score.notes)} notes of {score.title!r} are not in "
            f"{other.title!r}, first {_describe(missing[0], score)}: expected the same notes, with "
            "fingers of their own."
        )
    return pairs


def _describe(index: int, score: Score) -> str:
    note = score.notes[index]
    return f"note {index} ({pitch_name(note.pitch)} at {note.onset:g} s)"
