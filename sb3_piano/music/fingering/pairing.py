"""Which note of one score is which of another, where both hold the same music."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.note import Note
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.score import Score

SAME_ONSET = 1e-3
"""Onsets this close are the same, in s: formats round times, MIDI to 0.1 ms."""


def pair_notes(
    notes: Sequence[Note], others: Sequence[Note], tolerance: float = SAME_ONSET
) -> dict[int, int]:
    """Pair notes of one pitch whose onsets lie close together, each with one other at most.

    The nearest pairs are made first; of equally near ones, the earlier.

    Args:
        notes: The notes to be paired, sorted by onset.
        others: With which notes, sorted by onset.
        tolerance: How far apart the onsets of a pair may lie, in s.

    Returns:
        The index of the other note by the index of the note, of those that have a partner.
    """
    by_pitch: dict[int, list[int]] = defaultdict(list)
    for index, other in enumerate(others):
        by_pitch[other.pitch].append(index)
    first: dict[int, int] = defaultdict(int)  # by pitch: earlier ones are out of reach for good
    candidates: list[tuple[float, int, int]] = []
    for index, note in enumerate(notes):
        same_pitch = by_pitch[note.pitch]
        for place in range(first[note.pitch], len(same_pitch)):
            distance = others[same_pitch[place]].onset - note.onset
            if distance > tolerance:
                break
            if distance < -tolerance:
                first[note.pitch] = place + 1
                continue
            candidates.append((abs(distance), index, same_pitch[place]))
    return _nearest_first(candidates)


def pair_all(score: Score, other: Score) -> dict[int, int]:
    """Pair every note of a score with the same note of another.

    Raises:
        ScoreError: If `other` lacks a note of the score.
    """
    pairs = pair_notes(score.notes, other.notes)
    missing = [index for index in range(len(score.notes)) if index not in pairs]
    if missing:
        raise ScoreError(
            f"{len(missing)} of {len(score.notes)} notes of {score.title!r} are not in "
            f"{other.title!r}, first {describe(missing[0], score)}: expected the same notes, with "
            "fingers of their own."
        )
    return pairs


def describe(index: int, score: Score) -> str:
    """Return which note of a score it is, for messages: ``note 3 (C4 at 1.5 s)``."""
    note = score.notes[index]
    return f"note {index} ({pitch_name(note.pitch)} at {note.onset:g} s)"


def _nearest_first(candidates: list[tuple[float, int, int]]) -> dict[int, int]:
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, index, other in sorted(candidates):
        if index not in pairs and other not in taken:
            pairs[index] = other
            taken.add(other)
    return pairs
