"""Hands for the simulated hands: notes change hands where that saves sound, and only there."""

import dataclasses

import pytest
from short_scores import score_of

from sb3_piano.music import BUILT_IN, load_score
from sb3_piano.music.fingering import apply_fingering
from sb3_piano.music.fingering.robot_hands import robot_hands
from sb3_piano.music.hands import finger_of

STEP = 0.05


def hands_of(*notes):
    """The hand found for each (onset, pitch, length, R or L), in order of onset and pitch."""
    names = {"R": "right", "L": "left"}
    score = score_of(
        *((onset, onset + length, pitch, names[hand]) for onset, pitch, length, hand in notes)
    )
    found = robot_hands(score, STEP)
    return "".join("R" if note.hand == "right" else "L" for note in found.notes)


FAR = [(0.4 * i, 40 + i % 5, 0.4, "L") for i in range(12)]


def test_hands_that_play_by_turns_on_neighbouring_keys_become_one():
    turns = [(0.2 * i, 75 + i % 2, 0.2, "RL"[i % 2]) for i in range(12)]
    assert hands_of(*turns) == "R" * 12 or hands_of(*turns) == "L" * 12


def test_hands_that_have_room_keep_what_is_written():
    right = [(0.4 * i, 76 + i % 5, 0.4, "R") for i in range(12)]
    assert hands_of(*FAR, *right) == "LR" * 12


def test_a_note_that_a_hand_cannot_reach_goes_to_the_one_that_is_near():
    chord = [(0.0, pitch, 1.0, "R") for pitch in (50, 72, 76)]
    assert hands_of((0.0, 43, 1.0, "L"), *chord) == "LLRR"


def test_a_leap_in_the_middle_of_notes_is_saved_by_the_other_hand():
    high = [(0.2 * i, 76 + i % 3, 0.2, "R") for i in range(6)]
    low = [(1.2, 52, 0.2, "R")]
    back = [(1.4 + 0.2 * i, 76 + i % 3, 0.2, "R") for i in range(6)]
    assert hands_of((0.0, 50, 0.4, "L"), *high, *low, *back) == "LRRRRRR" + "L" + "RRRRRR"


def test_a_piece_for_one_hand_stays_with_it():
    score = load_score("scale-EbMajor")
    right = dataclasses.replace(
        score, notes=tuple(note for note in score.notes if note.hand == "right")
    )
    assert robot_hands(right, STEP) is right


def test_a_note_gets_a_finger_of_its_new_hand():
    score = load_score("FurElise")
    found = apply_fingering(score, "robot")
    moved = [
        (before, after)
        for before, after in zip(score.notes, found.notes, strict=True)
        if before.hand != after.hand
    ]
    assert 5 < len(moved) < 20
    for before, after in moved:
        assert after.finger in {finger_of(after.hand, finger) for finger in range(1, 6)}
        assert dataclasses.replace(after, hand=before.hand, finger=before.finger) == before


@pytest.mark.parametrize("name", [n for n in BUILT_IN if n.startswith(("scale", "arpeggio"))][::9])
def test_studies_of_scales_stay_as_they_are_written(name):
    score = load_score(name)
    assert robot_hands(score, STEP).notes == score.notes
