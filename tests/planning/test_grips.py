"""What a hand cannot hold at the same time it lets go, and nothing else."""

from __future__ import annotations

import dataclasses

import pytest
from hand_parts import SETTINGS, hand_presses, keys_of, scene_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.planning.fingers import _fit_hand
from sb3_piano.planning.grips import early_releases, out_of_reach
from sb3_piano.planning.presses import Press
from sb3_piano.simulation import KEY_IS_BLACK

KEYS = keys_of(scene_of())
WHITE = [key for key in range(88) if not KEY_IS_BLACK[key]]
MIDDLE = 23  # of the white keys: C4


def notes(*given_notes, sign=1):
    """Return presses of (white keys towards the little finger, finger, first, last)."""
    return sorted(
        (
            Press(WHITE[MIDDLE + sign * away], finger, first, last)
            for away, finger, first, last in given_notes
        ),
        key=lambda press: (press.first, press.key),
    )


def gone_of(presses, sign=1):
    """Return what is let go, as (finger, last state) of each."""
    fingers = [press.finger for press in presses]
    return {(one.press.finger, one.last) for one in early_releases(presses, fingers, sign, KEYS)}


def test_a_grip_is_out_of_reach_by_what_lacks_at_either_end():
    assert out_of_reach(0.074, 0, 1) == 0
    assert out_of_reach(0.080, 0, 1) == pytest.approx(0.006)
    assert out_of_reach(0.020, 1, 4) == pytest.approx(0.020)


@pytest.mark.parametrize("sign", [1, -1])
def test_what_a_hand_can_hold_is_held(sign):
    assert gone_of(notes((0, 0, 1, 20), (2, 1, 5, 20), (4, 4, 5, 30), sign=sign), sign) == set()


@pytest.mark.parametrize("sign", [1, -1])
def test_what_is_held_makes_way_for_what_is_struck_out_of_its_reach(sign):
    presses = notes((0, 0, 1, 40), (2, 1, 1, 9), (10, 4, 10, 20), sign=sign)
    (one,) = early_releases(presses, [press.finger for press in presses], sign, KEYS)
    assert (one.press.finger, one.last) == (0, 9)
    assert one.for_key == WHITE[MIDDLE + sign * 10]


def test_what_is_held_past_notes_within_its_reach_still_makes_way_later():
    assert gone_of(notes((0, 0, 1, 40), (2, 1, 5, 9), (10, 4, 20, 30))) == {(0, 19)}


def test_what_has_ended_before_need_not_make_way():
    assert gone_of(notes((0, 0, 1, 9), (10, 4, 10, 20))) == set()


@pytest.mark.parametrize("sign", [1, -1])
def test_of_a_chord_goes_what_is_too_far_from_most_of_it(sign):
    chord = notes((0, 0, 5, 20), (10, 3, 5, 20), (12, 4, 5, 20), sign=sign)
    assert gone_of(chord, sign) == {(0, 4)}
    chord = notes((0, 0, 5, 20), (2, 1, 5, 20), (12, 4, 5, 20), sign=sign)
    assert gone_of(chord, sign) == {(4, 4)}


@pytest.mark.parametrize("sign", [1, -1])
def test_of_two_the_one_at_the_thumb_goes(sign):
    assert gone_of(notes((0, 0, 5, 20), (12, 4, 5, 20), sign=sign), sign) == {(0, 4)}


def test_a_finger_lets_go_of_its_key_for_another_one():
    assert gone_of(notes((0, 2, 1, 20), (1, 2, 6, 20))) == {(2, 5)}


def test_fingers_that_cross_let_go_of_nothing():
    assert gone_of(notes((0, 3, 1, 20), (1, 2, 6, 20))) == set()


@pytest.mark.parametrize("sign", [1, -1])
def test_fingers_are_found_with_which_nothing_is_let_go(sign):
    """A fifth and a ninth: not for the index finger in between, which does not spread so far."""
    chord = notes((0, 0, 5, 20), (4, 1, 5, 20), (8, 4, 5, 20), sign=sign)
    assert gone_of(chord, sign) == {(0, 4)}
    kept, fingers, gone = _fit_hand(chord, sign, KEYS, SETTINGS)
    by_key = sorted(zip(kept, fingers, strict=True), key=lambda pair: sign * pair[0].key)
    assert [finger for _, finger in by_key] == [0, 2, 4]
    assert gone == []


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(hand_presses(), st.sampled_from([1, -1]))
def test_what_is_left_can_be_held_and_each_note_is_accounted_for(presses, sign):
    kept, fingers, gone = _fit_hand(presses, sign, KEYS, SETTINGS)
    assert early_releases(kept, fingers, sign, KEYS) == []
    last = {(press.key, press.first): press.last for press in kept}
    for press in presses:
        cut = [one for one in gone if one.press == press]
        assert len(cut) <= 1
        assert last.get((press.key, press.first), press.first - 1) == (
            max(cut[0].last, press.first - 1) if cut else press.last
        )


def test_a_note_that_is_let_go_twice_is_told_as_it_was_written():
    """Five fingers hold what is within reach; the sixth and the seventh key are for one of them."""
    five = [(away, away, 1, 60) for away in range(5)]
    presses = notes(*five, (14, 4, 20, 25), (-14, 0, 30, 35))
    gone = _fit_hand(presses, 1, KEYS, dataclasses.replace(SETTINGS, change_finger=0.0))[2]
    written = {(press.key, press.first): press for press in presses}
    assert gone
    for one in gone:
        assert one.press == written[one.press.key, one.press.first]
        assert one.last < one.press.last
