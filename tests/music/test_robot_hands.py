"""Hands for the simulated hands: notes change hands where that saves sound, and only there."""

import dataclasses

import pytest
from short_scores import score_of
from yaml_rows import Tables

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


def test_hands_that_play_by_turns_on_neighbouring_keys_become_one():
    turns = [(0.2 * i, 75 + i % 2, 0.2, "RL"[i % 2]) for i in range(12)]
    assert hands_of(*turns) == "R" * 12 or hands_of(*turns) == "L" * 12


@Tables(__file__)("why, notes, expected")
def test_notes_change_hands_where_that_saves_sound(why, notes, expected):
    assert hands_of(*notes) == expected, why


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
