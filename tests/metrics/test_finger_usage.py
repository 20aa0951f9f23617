"""Finger usage: who pressed which key, how evenly, and whether it was the labelled finger."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from yaml_rows import Tables

from sb3_piano.metrics.fingers import (
    KeyBoxes,
    effective_fingers,
    finger_shares,
    fingering_agreement,
    nearest_fingers,
)

tables = Tables(__file__)

FAR = 10.0  # m, where fingers are that do not matter


def level_keys(n=88):
    """Return keys of 20 x 2 x 2 cm, 3 cm apart along y, lengthwise along x."""
    return KeyBoxes(
        center=np.column_stack([np.zeros(n), 0.03 * np.arange(n), np.zeros(n)]),
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        half_size=np.tile([0.1, 0.01, 0.01], (n, 1)),
    )


def tips(*placed, steps=1):
    """Return (T, 10, 3) fingertips, far away but for (step, finger, (x, y, z))."""
    points = np.full((steps, 10, 3), FAR)
    for step, finger, point in placed:
        points[step, finger] = point
    return points


def sounding(*cells, steps=1):
    array = np.zeros((steps, 88), dtype=bool)
    for step, key in cells:
        array[step, key] = True
    return array


class TestNearestFingers:
    def test_of_several_fingers_inside_the_key_the_lowest_has_pressed_it(self):
        fingertips = tips((0, 8, (0, 0, 0)), (0, 4, (0.05, 0.005, 0.01)))
        assert nearest_fingers(sounding((0, 0)), fingertips, level_keys())[0, 0] == 4

    def test_silent_keys_have_no_finger(self):
        assert (nearest_fingers(sounding(), tips(), level_keys()) == -1).all()
        assert nearest_fingers(sounding(steps=0), tips(steps=0), level_keys()).shape == (0, 88)

    @pytest.mark.slow
    @given(st.integers(0, 2**32 - 1))
    def test_the_finger_equals_a_plain_python_twin(self, seed):
        rng = np.random.default_rng(seed)
        keys = KeyBoxes(
            center=rng.uniform(-0.2, 0.2, (88, 3)),
            rotation=Rotation.random(88, rng).as_matrix(),
            half_size=rng.uniform(0.005, 0.1, (88, 3)),
        )
        active, fingertips = rng.random((3, 88)) < 0.05, rng.uniform(-0.3, 0.3, (3, 10, 3))
        fingers = nearest_fingers(active, fingertips, keys)
        assert ((fingers >= 0) == active).all()
        for step, key in np.argwhere(active):
            distances = [box_distance(point, keys, key) for point in fingertips[step]]
            assert distances[fingers[step, key]] == pytest.approx(min(distances))


def box_distance(point, keys, key):
    """Return the distance of a point to a key: to the point of the box that is nearest to it."""
    nearest = keys.center[key].copy()
    for axis in range(3):
        direction = keys.rotation[key][:, axis]
        along = float(np.dot(point - keys.center[key], direction))
        half = keys.half_size[key, axis]
        nearest += min(max(along, -half), half) * direction
    return math.dist(point, nearest)


class TestShares:
    def test_a_share_is_of_all_steps_in_which_a_key_is_pressed(self):
        press_finger = np.array([[0, -1, 9], [0, 2, -1], [0, -1, -1]], dtype=np.int8)
        shares = finger_shares(press_finger)
        np.testing.assert_allclose(shares, [3 / 5, 0, 1 / 5, 0, 0, 0, 0, 0, 0, 1 / 5])


class TestEffectiveFingers:
    @tables("shares, expected")
    def test_effective_fingers_of_hand_worked_cases(self, shares, expected):
        assert effective_fingers(shares) == pytest.approx(expected)

    @given(st.lists(st.integers(0, 1000), min_size=1, max_size=10))
    def test_the_number_lies_between_one_and_the_fingers_that_play(self, counts):
        number, used = effective_fingers(counts), np.count_nonzero(counts)
        assert (number == 0.0) if used == 0 else (1.0 <= number <= used + 1e-9)


class TestAgreement:
    def test_only_labelled_keys_that_sound_and_are_due_count(self):
        pressed = np.array([[0, 1, 2, -1, 4], [0, 9, -1, 3, 7]])
        label = np.array([[0, 2, -1, 3, 4], [5, 9, -1, -1, -1]])
        # Judged: 0 = 0, 1 for 2, 4 = 4; 0 for 5, 9 = 9. Not due, unlabelled and silent ones: not.
        assert fingering_agreement(pressed, label) == pytest.approx(3 / 5)
