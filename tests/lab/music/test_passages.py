"""Kinds of passages, on a few notes each."""

from __future__ import annotations

from yaml_rows import Tables

from sb3_piano.lab.music.passages import passages
from sb3_piano.music import Note, Score

tables = Tables(__file__)


@tables("pitches, fingers, kinds")
def test_single_notes_are_told_by_intervals_and_fingers(pitches, fingers, kinds):
    notes = [
        Note(onset=0.5 * k, offset=0.5 * k + 0.4, pitch=pitch, velocity=80, finger=finger)
        for k, (pitch, finger) in enumerate(zip(pitches, fingers, strict=True))
    ]
    found = [set(each) for each in passages(Score(notes=notes, title="a line"))]
    assert found == [{kind} for kind in kinds]


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
