"""Fingers for the simulated hand: what it can do stays as written, what it cannot is changed."""

import dataclasses
from itertools import groupby, pairwise

import numpy as np
import pytest
from drawn_presses import hand_presses
from hypothesis import given
from hypothesis import strategies as st
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.hands import find_hand
from sb3_piano.music import BUILT_IN, PianoRoll, load_score
from sb3_piano.music.constants import KEY_IS_BLACK, NUM_KEYS
from sb3_piano.music.fingering import apply_fingering, robot
from sb3_piano.music.fingering.problems import unheld
from sb3_piano.music.fingering.robot import (
    CHANGE_FINGER,
    KEY_Y,
    _early_releases,
    _Robot,
    choose,
    release_early,
    robot_fingers,
)
from sb3_piano.music.fingering.robot_hands import robot_hands
from sb3_piano.music.hands import finger_of
from sb3_piano.music.presses import Press
from sb3_piano.reading import KeyPlaces
from sb3_piano.simulation import compile_scene

tables = Tables(__file__)

WHITE = [key for key in range(NUM_KEYS) if not KEY_IS_BLACK[key]]
MIDDLE = 23  # of the white keys: C4
AS_WRITTEN = 1e6
BOTH_HANDS = pytest.mark.parametrize("sign", [1, -1])


def test_the_keys_are_where_the_simulation_has_them():
    np.testing.assert_array_equal(KEY_Y, KeyPlaces.of(compile_scene()).y)


def notes(*given_notes, sign=1):
    """Return presses of (white keys towards the little finger, finger, first, last)."""
    return sorted(
        (
            Press(WHITE[MIDDLE + sign * away], finger, first, last)
            for away, finger, first, last in given_notes
        ),
        key=lambda press: (press.first, press.key),
    )


def every_way(presses, sign):
    """Yield every way to finger a piece, with its cost."""
    model, path, tables = _Robot(sign, CHANGE_FINGER, find_hand()), [], []
    for _, struck in groupby(presses, key=lambda press: press.first):
        chord = list(struck)
        held, _ = model.held(path[-1].down if path else [], chord)
        onset = model.lay(path, held, chord)
        tables.append(model.costs(path, onset))
        path.append(onset)

    def follow(number, state):
        if number == len(path):
            yield {}, 0.0
            return
        for after in np.flatnonzero(np.isfinite(tables[number][state])):
            here = dict(zip(path[number].down, path[number].states[after], strict=True))
            for fingers, cost in follow(number + 1, after):
                yield here | fingers, tables[number][state, after] + cost

    return follow(0, 0)


@given(hand_presses(most=5), st.sampled_from([1, -1]))
def test_no_other_fingers_cost_less(presses, sign):
    chosen = dict(zip(presses, choose(presses, sign), strict=True))
    ways = list(every_way(presses, sign))
    cost = next(cost for fingers, cost in ways if fingers == chosen)
    assert cost == pytest.approx(min(cost for _, cost in ways))


@BOTH_HANDS
def test_what_lies_under_the_hand_stays_as_it_is_written(sign):
    order = (0, 2, 1, 4, 3, 2)
    presses = notes(*((i, i, 1 + 4 * n, 4 + 4 * n) for n, i in enumerate(order)), sign=sign)
    assert choose(presses, sign) == list(order)


@BOTH_HANDS
def test_a_grip_that_is_too_wide_for_its_fingers_gets_others(sign):
    wide = notes((0, 1, 1, 20), (5, 3, 1, 20), sign=sign)  # a sixth between index and ring finger
    assert sorted(choose(wide, sign)) == [0, 3]
    assert sorted(choose(wide, sign, AS_WRITTEN)) == [1, 3]


def test_thumbs_leave_black_keys_to_other_fingers(monkeypatch):
    presses = [Press(int(np.flatnonzero(KEY_IS_BLACK)[20]), 0, 1, 9)]
    assert choose(presses, 1) != [0]
    monkeypatch.setattr(robot, "_THUMB_ON_BLACK", 0.0)
    assert choose(presses, 1) == [0]


def test_no_finger_but_the_thumb_passes_another_one():
    """Fourth finger, then the third beyond it: the hand would have to leap over its own finger."""
    fourth, third = choose(notes((0, 3, 1, 5), (2, 2, 6, 10)), 1)
    assert fourth < third
    assert choose(notes((0, 2, 1, 5), (1, 0, 6, 10)), 1, 3.0) == [2, 0]


def test_fewer_leaps_are_worth_a_change():
    """Six white keys upwards, thumb and index finger in turn: five leaps; other ways have one."""
    steps = notes(*((i, i % 2, 1 + 5 * i, 5 + 5 * i) for i in range(6)))
    turns = sum(after <= before for before, after in pairwise(choose(steps, 1)))
    assert turns == 1


# What cannot be held.


def gone_of(presses, sign=1):
    """Return what is let go, as (finger, last state) of each."""
    return {(one.finger % 5, one.release) for one in _early_releases(presses, sign, find_hand())}


@BOTH_HANDS
@tables("held, expected, why")
def test_what_a_hand_cannot_hold_makes_way(held, expected, why, sign):
    assert gone_of(notes(*held, sign=sign), sign) == set(map(tuple, expected)), why


# Scores and rolls.


drawn_notes = st.builds(
    lambda pitch, finger, onset, length: (onset / 20, (onset + length) / 20, pitch, finger),
    pitch=st.integers(40, 80),
    finger=st.integers(0, 9),
    onset=st.integers(0, 30),
    length=st.integers(1, 20),
)


@pytest.mark.slow
@given(st.lists(drawn_notes, min_size=1, max_size=10))
def test_what_is_left_of_a_roll_can_be_held_and_each_note_is_accounted_for(drawn):
    roll = PianoRoll.from_score(robot_fingers(score_of(*drawn), 0.05), 0.05)
    held = release_early(roll)
    assert not held.unlabelled.any()
    assert release_early(held).early_releases == held.early_releases, "once is enough"
    released = np.zeros_like(roll.active)
    for one in held.early_releases:
        assert one.onset <= one.release < one.offset
        assert (roll.finger[one.onset : one.offset, one.key] == one.finger).all()
        released[one.release : one.offset, one.key] = True
    np.testing.assert_array_equal(held.finger, np.where(released, -1, roll.finger))
    np.testing.assert_array_equal(held.active, roll.active)


@pytest.mark.slow
@given(st.lists(drawn_notes, min_size=1, max_size=10))
def test_only_fingers_change_and_each_note_stays_with_its_hand(drawn):
    score = score_of(*drawn)
    fingered = robot_fingers(score, 0.05)
    for note, other in zip(score.notes, fingered.notes, strict=True):
        assert dataclasses.replace(other, finger=note.finger) == note
        assert other.finger // 5 == note.finger // 5


def test_a_chord_no_finger_can_hold_as_written_is_refingered_so_that_nothing_is_released():
    """A fifth and a ninth: not for the index finger in between, which does not spread so far."""
    score = score_of((0.0, 0.5, 60, 0), (0.0, 0.5, 67, 1), (0.0, 0.5, 74, 4))
    assert release_early(PianoRoll.from_score(score, 0.05)).early_releases
    fingered = robot_fingers(score, 0.05)
    assert [note.finger for note in fingered.notes] == [0, 2, 4]
    assert not release_early(PianoRoll.from_score(fingered, 0.05)).early_releases


@pytest.mark.parametrize("start", [0.0, 0.02, 1.33])
def test_where_a_piece_begins_makes_no_difference_and_bare_notes_get_fingers_first(start):
    bare = score_of(*((start + 0.3 * i, start + 0.3 * i + 0.3, 60 + 4 * (i % 3)) for i in range(6)))
    fingers = [note.finger for note in apply_fingering(bare, "robot").notes]
    assert -1 not in fingers
    trimmed = apply_fingering(bare.trim_silence(), "robot")
    assert [note.finger for note in trimmed.notes] == fingers


@pytest.mark.parametrize("period", [0.4, 0.375, 0.33])
def test_touching_octaves_keep_the_fingers_of_an_octave_at_any_tempo(period):
    # Rounding to control steps makes some of them overlap by a step.
    octaves = (
        (period * i, period * (i + 1), pitch + octave, "right")
        for i, pitch in enumerate((60, 62, 64, 65, 67, 69, 71, 72))
        for octave in (0, 12)
    )
    found = apply_fingering(score_of(*octaves), "robot")
    assert [note.finger for note in found.notes] == [0, 4] * 8
    roll = release_early(PianoRoll.from_score(found, 0.05))
    assert all(one.release >= one.offset - 1 for one in roll.early_releases)
    assert unheld(roll) == []


# Hands: notes change hands where that saves sound, and only there.


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


def test_only_the_cheapest_ways_go_on(monkeypatch):
    steps = enumerate(zip((0, 2, 4, 6, 3, 8, 1), (0, 1, 2, 0, 3, 4, 0), strict=True))
    presses = notes(*((*one, 3 * i + 1, 3 * i + 3) for i, one in steps))
    exact = choose(presses, 1, 0.0)
    monkeypatch.setattr(robot, "_MOST_STATES", 1)
    assert choose(presses, 1, 0.0) != exact
