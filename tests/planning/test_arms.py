"""The line between the arms: who gives way to whom."""

from __future__ import annotations

import numpy as np
import pytest
from hand_parts import SETTINGS, hand_of, keys_of, scene_of
from hypothesis import given, settings
from hypothesis import strategies as st

from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.music.presses import Press
from sb3_piano.planning.arms import bounds_of, dividing_line, wanted_places
from sb3_piano.planning.key_frames import key_frames
from sb3_piano.planning.presses import TimedPress

SCENE = scene_of()
KEYS = keys_of(SCENE)
BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])

APART = 0.16  # m

places = st.floats(-0.6, 0.6, allow_nan=False)


def bounds(right, left, right_busy, left_busy):
    """Return the bounds of the two arms in one state."""
    line = dividing_line(
        [np.array([right]), np.array([left])],
        [np.array([right_busy]), np.array([left_busy])],
        APART,
    )
    right_bound, left_bound = bounds_of(line, APART)
    return float(right_bound[0]), float(left_bound[0])


@settings(max_examples=40, deadline=None)
@given(places, places, st.booleans(), st.booleans())
def test_the_bounds_keep_the_arms_apart_the_right_one_to_the_right(right, left, busy, other_busy):
    right_bound, left_bound = bounds(right, left, busy, other_busy)
    assert right_bound - left_bound == pytest.approx(APART)


@settings(max_examples=40, deadline=None)
@given(places, places, st.booleans())
def test_a_hand_that_plays_is_not_pushed_by_one_that_rests(right, left, right_plays):
    right_bound, left_bound = bounds(right, left, right_plays, not right_plays)
    if right_plays:
        assert right_bound <= right + 1e-9
    else:
        assert left_bound >= left - 1e-9


@settings(max_examples=40, deadline=None)
@given(places, places)
def test_two_hands_that_play_share_what_is_missing(right, left):
    right_bound, left_bound = bounds(right, left, True, True)
    pushed_right, pushed_left = max(right_bound - right, 0), max(left - left_bound, 0)
    assert pushed_right == pytest.approx(pushed_left, abs=1e-9)
    assert pushed_right + pushed_left == pytest.approx(max(left + APART - right, 0), abs=1e-9)


def frames_of(hand, presses, n_states=60):
    kinematics = hand_of(SCENE, hand)
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    return key_frames(timed, kinematics.sign, n_states, kinematics.radius, KEYS, SETTINGS)


def wanted(hand, presses):
    kinematics = hand_of(SCENE, hand)
    return wanted_places(frames_of(hand, presses), kinematics.sign, kinematics.middle)


@BOTH_HANDS
def test_a_hand_that_plays_nothing_wants_to_stay_where_it_rests(hand):
    place, busy = wanted(hand, [])
    assert not busy.any()
    arm = hand_of(SCENE, hand).arm(np.zeros((1, hand_of(SCENE, hand).size)))[0]
    np.testing.assert_allclose(place, arm, atol=1e-9)


@BOTH_HANDS
@pytest.mark.parametrize("finger", range(5))
def test_a_hand_that_plays_wants_to_be_where_its_finger_is_over_the_key(hand, finger):
    key = 45
    place, _ = wanted(hand, [Press(key, finger, 30, 34)])
    sign = hand_of(SCENE, hand).sign
    assert place[32] + sign * (finger - 2) * KEY_SPACING == pytest.approx(KEYS.y[key])


@BOTH_HANDS
def test_between_two_notes_a_hand_is_on_its_way_from_one_to_the_other(hand):
    place, busy = wanted(hand, [Press(40, 2, 5, 8), Press(64, 2, 50, 54)])
    assert (np.diff(place) >= -1e-12).all()
    assert KEYS.y[40] < place[25] < KEYS.y[64]
    assert busy[[5, 8, 50, 54]].all()
    assert not busy[25]
