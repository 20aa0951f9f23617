"""Kinds of passages, on a few notes each."""

from __future__ import annotations

import pytest

from sb3_piano.lab.music.passages import passages
from sb3_piano.music import Note, Score

# Pitches and fingers (0-4 right, 5-9 left) of notes that follow each other, and each note's kinds.
LINES = {
    "five notes up": ([60, 62, 64, 65, 67], [0, 1, 2, 3, 4], [{"scale"}] * 5),
    "three notes are no scale": ([60, 62, 64], [0, 1, 2], [{"other"}] * 3),
    "a turn ends a scale": (
        [60, 62, 64, 65, 64],
        [0, 1, 2, 3, 2],
        [{"scale"}] * 4 + [{"other"}],
    ),
    "a broken chord down": ([72, 67, 64, 60], [4, 2, 1, 0], [{"arpeggio"}] * 4),
    "right thumb under": ([64, 65], [2, 0], [{"thumb-under"}] * 2),
    "right finger over": ([65, 64], [0, 2], [{"thumb-under"}] * 2),
    "left thumb under": ([53, 52], [7, 5], [{"thumb-under"}] * 2),
    "a left hand that goes out": ([52, 53], [7, 5], [{"other"}] * 2),
    "no thumb": ([64, 65], [3, 2], [{"other"}] * 2),
    "fingers in their order": ([60, 64], [0, 2], [{"other"}] * 2),
    "fingers are not known": ([65, 64], [-1, 0], [{"other"}] * 2),
}


@pytest.mark.parametrize(("pitches", "fingers", "kinds"), LINES.values(), ids=LINES)
def test_single_notes_are_told_by_intervals_and_fingers(pitches, fingers, kinds):
    notes = [
        Note(onset=0.5 * k, offset=0.5 * k + 0.4, pitch=pitch, velocity=80, finger=finger)
        for k, (pitch, finger) in enumerate(zip(pitches, fingers, strict=True))
    ]
    assert [set(each) for each in passages(Score(notes=notes, title="a line"))] == kinds


def held(*notes: tuple[float, float, int, int]) -> list[set[str]]:
    score = Score(
        notes=[
            Note(onset=onset, offset=offset, pitch=pitch, velocity=80, finger=finger)
            for onset, offset, pitch, finger in notes
        ],
        title="held",
    )
    return [set(each) for each in passages(score)]


def test_octaves_are_struck_together_by_one_hand():
    assert held((0.0, 1.0, 60, 0), (0.01, 1.0, 72, 4)) == [{"octave"}] * 2
    assert held((0.0, 1.0, 60, 5), (0.0, 1.0, 72, 0)) == [{"other"}] * 2, "of two hands"
    assert held((0.0, 0.4, 60, 0), (0.5, 1.0, 72, 4)) == [{"other"}] * 2, "one after the other"


def test_hands_are_crossed_while_the_left_hand_holds_the_higher_note():
    assert held((0.0, 1.0, 60, 0), (0.5, 1.0, 64, 5)) == [{"hands crossed"}] * 2
    assert held((0.0, 0.5, 60, 0), (0.5, 1.0, 64, 5)) == [{"other"}] * 2, "the right hand is gone"
    assert held((0.0, 1.0, 60, 5), (0.5, 1.0, 64, 0)) == [{"other"}] * 2
