"""Measure the agreement of two fingerings of the same notes.

The match rates are from E. Nakamura, Y. Saito and K. Yoshii, "Statistical learning and estimation
of piano fingering", Information Sciences 517, 2020 (arXiv 1904.10237). Where the text is ambiguous,
they follow the authors' released evaluation program (Evaluate_MultipleGroundTruth), the source of
their figures.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.fingering.apply import finger_score, without_fingers
from sb3_piano.music.fingering.labels import pair_all
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.hands import HANDS
from sb3_piano.music.score import Score

_PIG_FILE = re.compile(r"(\d+)-\d+_fingering\.txt", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Number of labelled notes to which another fingering gives the same finger.

    A hand's share is None if it has no labelled notes.
    """

    notes: tuple[int, int]
    """Labelled notes of the right and of the left hand."""
    same_finger: tuple[int, int]
    """Labelled notes with the same finger of the same hand in both fingerings."""
    same_hand: tuple[int, int]
    """Labelled notes with the same hand in both fingerings, with any finger."""

    @property
    def right(self) -> float | None:
        """Share of the right hand's labelled notes with the same finger."""
        return self.same_finger[0] / self.notes[0] if self.notes[0] else None

    @property
    def left(self) -> float | None:
        """Share of the left hand's labelled notes with the same finger."""
        return self.same_finger[1] / self.notes[1] if self.notes[1] else None

    @property
    def both(self) -> float:
        """Share of all labelled notes with the same finger."""
        return sum(self.same_finger) / sum(self.notes)

    @property
    def hands(self) -> float:
        """Share of all labelled notes with the same hand."""
        return sum(self.same_hand) / sum(self.notes)


@dataclass(frozen=True, kw_only=True)
class MatchRates:
    """Match rates of a fingering with several annotators' fingerings, each in [0, 1].

    Always ``general <= highest <= recombination <= soft``.
    """

    notes: int
    """Number of notes that count: every annotator gave them a finger."""
    general: float
    """M_gen: the share of notes with an annotator's finger, averaged over the annotators."""
    highest: float
    """M_high: that share for the best annotator, chosen for each hand."""
    soft: float
    """M_soft: the share of notes with the finger of any annotator."""
    recombination: float
    """M_rec: that share for the best path from annotator to annotator, less the changes."""


def agreement(labelled: Score, other: Score) -> Agreement:
    """Compare a fingering with labels, note by note.

    Args:
        labelled: The score with the reference labels; its unlabelled notes do not count.
        other: The same notes (pitches and onsets, to 1 ms), with other fingers. A note without a
            finger agrees with no label.

    Raises:
        ScoreError: If no note is labelled, or `other` lacks a note.
    """
    pairs = pair_all(labelled, other)
    counts = {hand: [0, 0, 0] for hand in HANDS}
    for index, note in enumerate(labelled.notes):
        if note.finger == UNKNOWN_FINGER or note.hand is None:
            continue
        partner = other.notes[pairs[index]]
        count = counts[note.hand]
        count[0] += 1
        count[1] += partner.finger == note.finger
        count[2] += partner.hand == note.hand
    if not any(count[0] for count in counts.values()):
        raise ScoreError(f"Score {labelled.title!r} has no finger labels: expected at least one.")
    right, left = (counts[hand] for hand in HANDS)
    return Agreement(
        notes=(right[0], left[0]), same_finger=(right[1], left[1]), same_hand=(right[2], left[2])
    )


def match_rates(annotations: Sequence[Score], other: Score) -> MatchRates:
    r"""Compare a fingering with the fingerings of several annotators.

    N is the number of notes, :math:`f_n` is the finger of note n and :math:`f^k_n` annotator k's.
    Each sum is taken over the notes of each hand of `other` separately; then the hands are added:

    - M_gen: mean over k of :math:`\frac{1}{N} \sum_n [f_n = f^k_n]`,
    - M_high: :math:`\frac{1}{N} \max_k \sum_n [f_n = f^k_n]`,
    - M_soft: :math:`\frac{1}{N} \sum_n [f_n = f^k_n \text{ for some } k]`,
    - M_rec: :math:`\frac{1}{N} \max_{k_1 \dots k_N} \sum_n [f_n = f^{k_n}_n] - [k_n \ne k_{n-1}]`,
      where a path may change the annotator only after a note to which both gave the same finger.
      The maximum is found by dynamic programming.

    The notes of a chord are ordered upwards. If the finger changes on a held key, only the first
    finger counts, also for M_gen; there the authors' program asks for the same change.

    Args:
        annotations: The reference fingerings, one from each annotator. Notes without a finger in
            any of them do not count.
        other: The same notes (pitches and onsets, to 1 ms) with the fingers to evaluate. A note
            without a finger matches none.

    Raises:
        ScoreError: If there are no annotations, they have no labelled note in common, or their
            notes are not those of `other`.
    """
    if not annotations:
        raise ScoreError(f"There are no annotations of {other.title!r}: expected at least one.")
    truths = np.array([_aligned(annotation, other) for annotation in annotations])
    counted = (truths != UNKNOWN_FINGER).all(0)
    total = int(counted.sum())
    if not total:
        raise ScoreError(
            f"The annotations of {other.title!r} have no labelled note in common: expected at "
            "least one."
        )
    same = truths == [note.finger for note in other.notes]
    highest = soft = recombined = 0
    for hand in HANDS:  # notes of neither hand have no finger, and match nothing
        notes = counted & [note.hand == hand for note in other.notes]
        highest += int(same[:, notes].sum(1).max())
        soft += int(same[:, notes].any(0).sum())
        recombined += _recombined(same[:, notes], truths[:, notes])
    return MatchRates(
        notes=total,
        general=int(same[:, counted].sum()) / len(truths) / total,
        highest=highest / total,
        soft=soft / total,
        recombination=recombined / total,
    )


def _aligned(annotation: Score, other: Score) -> list[int]:
    """Return an annotator's fingers in the order of the notes of `other`."""
    pairs = pair_all(other, annotation)
    pair_all(annotation, other)  # nor may an annotation have notes that `other` lacks
    return [annotation.notes[pairs[n]].finger for n in range(len(other.notes))]


def _recombined(same: NDArray[np.bool_], truths: NDArray[np.int_]) -> int:
    """Maximise matching fingers minus changes of annotator over all paths.

    Args:
        same: (annotators, notes) whether the finger is the annotator's.
        truths: (annotators, notes) the annotators' fingers.
    """
    changes = 1.0 - np.eye(len(truths))
    value = np.zeros(len(truths))
    for n, right in enumerate(same.T):
        if n > 0:
            before = truths[:, n - 1]
            value = np.where(before[:, None] == before, value[:, None] - changes, -np.inf).max(0)
        value = value + right
    return int(value.max())


# Our own fingering, judged.


def judge(labelled: Score) -> Agreement:
    """Compare our fingering with the labels of a score.

    Fingers are computed with the labels' hands, as a score on two staves gives them; hands are
    computed without any labels.

    Raises:
        ScoreError: If no note is labelled.
    """
    fingers = agreement(labelled, finger_score(without_fingers(labelled, keep_hands=True)))
    hands = agreement(labelled, assign_hands(without_fingers(labelled, keep_hands=False)))
    return replace(fingers, same_hand=hands.same_hand)


def judge_annotated(annotations: Sequence[Score]) -> MatchRates:
    """Compare our fingering with several annotators', using the hands of the first one.

    Raises:
        ScoreError: If there are no annotations, their notes differ, or they have no labelled note
            in common.
    """
    if not annotations:
        raise ScoreError("There are no annotations: expected at least one.")
    return match_rates(annotations, finger_score(without_fingers(annotations[0], keep_hands=True)))


def pig_files(folder: str | os.PathLike[str]) -> Mapping[str, Sequence[Path]]:
    """Find the fingering files of the PIG data set, by number of the piece.

    The file ``001-1_fingering.txt`` is piece 001 by annotator 1. The folder is searched
    recursively.

    Raises:
        ScoreError: If the folder has none.
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
