"""How well our fingering agrees with labels: of one piece, of a folder of annotated ones."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.agreement import Agreement, MatchRates, agreement, match_rates
from sb3_piano.music.fingering.finger import finger_score
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.score import Score

_PIG_FILE = re.compile(r"(\d+)-\d+_fingering\.txt", re.IGNORECASE)


def without_fingers(score: Score, *, keep_hands: bool) -> Score:
    """Return the score with no finger known, and hands only if they are kept."""
    notes = [
        replace(note, finger=UNKNOWN_FINGER, hand=note.hand if keep_hands else None)
        for note in score.notes
    ]
    return replace(score, notes=tuple(notes))


def judge(labelled: Score) -> Agreement:
    """Compare our fingering with the labels of a score.

    Fingers are ours for the labels' hands, as a score on two staves tells them; hands are those
    that we find without being told.

    Raises:
        ScoreError: If no note is labelled, or the score cannot be played.
    """
    fingers = agreement(labelled, finger_score(without_fingers(labelled, keep_hands=True)))
    hands = agreement(labelled, assign_hands(without_fingers(labelled, keep_hands=False)))
    return replace(fingers, same_hand=hands.same_hand)


def judge_annotated(annotations: Sequence[Score]) -> MatchRates:
    """Compare our fingering with those of several annotators, for the hands of the first one.

    Raises:
        ScoreError: If there are no annotations, their notes differ, they have no labelled note in
            common, or the piece cannot be played.
    """
    if not annotations:
        raise ScoreError("There are no annotations: expected at least one.")
    return match_rates(annotations, finger_score(without_fingers(annotations[0], keep_hands=True)))


def pig_files(folder: str | os.PathLike[str]) -> Mapping[str, Sequence[Path]]:
    """Return the fingering files of the PIG data set by the number of their piece.

    They are called ``001-1_fingering.txt``, piece 001 by annotator 1, in the folder or anywhere
    below it.

    Raises:
        ScoreError: If there are none.
    """
    pieces: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(Path(folder).rglob("*.txt")):
        match = _PIG_FILE.fullmatch(path.name)
        if match is not None:
            pieces[match[1]].append(path)
    if not pieces:
        raise ScoreError(
            f"Folder '{folder}' has no fingering files: expected the PIG data set, files such as "
            "001-1_fingering.txt."
        )
    return dict(sorted(pieces.items()))
