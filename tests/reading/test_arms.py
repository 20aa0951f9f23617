"""The line between the arms: who gives way to whom."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sb3_piano.reading.piece import bounds_of, dividing_line

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


@given(places, places, st.booleans(), st.booleans())
def test_the_bounds_keep_the_arms_apart_the_right_one_to_the_right(right, left, busy, other_busy):
    right_bound, left_bound = bounds(right, left, busy, other_busy)
    assert right_bound - left_bound == pytest.approx(APART)


@given(places, places, st.booleans())
def test_a_hand_that_plays_is_not_pushed_by_one_that_rests(right, left, right_plays):
    right_bound, left_bound = bounds(right, left, right_plays, not right_plays)
    if right_plays:
        assert right_bound <= right + 1e-9
    else:
        assert left_bound >= left - 1e-9


@given(places, places)
def test_two_hands_that_play_share_what_is_missing(right, left):
    right_bound, left_bound = bounds(right, left, True, True)
    pushed_right, pushed_left = max(right_bound - right, 0), max(left - left_bound, 0)
    assert pushed_right == pytest.approx(pushed_left, abs=1e-9)
    assert pushed_right + pushed_left == pytest.approx(max(left + APART - right, 0), abs=1e-9)
