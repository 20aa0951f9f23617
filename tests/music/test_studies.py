from pathlib import Path

import numpy as np
import pytest
from yaml_rows import Tables

from sb3_piano.music import PianoRoll, load_score
from sb3_piano.music.studies.debug import DEBUG, major_scale

tables = Tables(__file__)

_HANDS = ("OneHand", "TwoHands")
REFERENCE = Path(__file__).parents[1] / "data" / "reference"


@tables("name, file")
def test_rolls_equal_those_of_robopianist(name, file):
    reference = np.load(REFERENCE / f"{file}.npz")
    buffer = float(reference.get("initial_buffer_time", 0.0))
    roll = PianoRoll.from_score(load_score(name), 0.05, initial_buffer_time=buffer)
    steps, keys = np.nonzero(roll.active)
    rows = np.column_stack([steps, keys, roll.finger[steps, keys]])
    assert np.array_equal(rows, reference["roll_notes"])
    assert np.array_equal(roll.sustain, reference["sustains"])


@pytest.mark.parametrize("name", [name.removeprefix("debug-") for name in DEBUG])
def test_titles_are_the_names_and_every_note_has_a_finger(name):
    score = load_score(name)
    assert score.title == name
    assert all(0 <= note.finger <= 9 and note.velocity == 80 for note in score.notes)


@pytest.mark.parametrize("key", ["C", "D"])
def test_one_hand_is_the_right_hand_of_two(key):
    two_hands = load_score(f"{key}MajorScaleTwoHands").notes
    right = tuple(note for note in two_hands if note.finger <= 4)
    assert load_score(f"{key}MajorScaleOneHand").notes == right


def test_twinkle_has_two_phrases_that_end_in_a_long_note():
    notes = load_score("TwinkleTwinkleLittleStar").notes
    assert [note.pitch for note in notes] == [
        *(60, 60, 67, 67, 69, 69, 67),
        *(65, 65, 64, 64, 62, 62, 60),
    ]
    assert [note.finger for note in notes] == [0, 0, 2, 2, 3, 3, 2, 3, 3, 2, 2, 1, 1, 0]
    assert [note.duration for note in notes] == ([0.5] * 6 + [1.0]) * 2
    assert [note.onset for note in notes[6:8]] == [3.0, 4.0]


@tables("name, bars")
def test_the_studies_are_in_four_four_time(name, bars):
    assert load_score(name).bars == tuple(bars)


def test_a_scale_starts_where_and_lasts_as_long_as_asked():
    scale = major_scale(left=40, note_duration=0.25, title="E")
    assert [note.pitch for note in scale.notes[:8]] == [40, 42, 44, 45, 47, 49, 51, 52]
    assert (scale.duration, scale.title) == (3.75, "E")
