"""The costs of fingers on keys, against the rules as published and worked by hand."""

import itertools

import numpy as np
import pytest
from published_rules import PARNCUTT_HAND, PARNCUTT_WEIGHTS

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.cost import MAX_INTERVAL, CostTables, FingeringWeights

PARNCUTT = CostTables(PARNCUTT_WEIGHTS, PARNCUTT_HAND)


def points(table, first, second, fingers):
    """The cost of two pitches with two fingers, numbered as pianists do."""
    at = (first % 12, second - first + MAX_INTERVAL, fingers[0] - 1, fingers[1] - 1)
    return pytest.approx(float(table[at]), rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(
    ("first", "second", "fingers", "expected", "why"),
    [
        (60, 64, (1, 3), 0, "relaxed"),
        (60, 70, (2, 5), 4 + 8, "two semitones beyond comfortable, four beyond relaxed"),
        (60, 62, (1, 5), 5, "five semitones less than relaxed, with the thumb"),
        (60, 62, (2, 5), 6, "three semitones less than relaxed, without the thumb"),
        (60, 67, (1, 2), 2, "two semitones more than relaxed, with the thumb"),
        (67, 60, (2, 1), 2, "the same downwards"),
        (64, 65, (3, 1), 4 + 1, "four semitones less than relaxed, passing on one level"),
        (66, 67, (4, 1), 6, "six semitones less than relaxed, the thumb on white under black"),
        (65, 66, (3, 1), 4 + 3, "four semitones less than relaxed, the thumb passing to black"),
        (65, 64, (1, 3), 4 + 1, "the finger passing over the thumb"),
        (60, 66, (2, 3), 2 * 3 + 2 * 4 + 1000, "three semitones beyond comfortable, one at all"),
    ],
)
def test_two_keys_in_succession_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.moves, first, second, fingers) == expected, why


@pytest.mark.parametrize(
    ("first", "second", "fingers", "expected", "why"),
    [
        (60, 62, (3, 4), 1, "three to four"),
        (62, 60, (4, 3), 0, "not four to three"),
        (60, 61, (3, 4), 1 + 1, "three to four, and four on black"),
        (61, 60, (4, 3), 1, "four on black, on the way down"),
        (61, 62, (3, 4), 1, "three on black is no matter"),
        (60, 61, (2, 1), 2, "thumb on black after a white key"),
        (61, 60, (1, 2), 2, "thumb on black before a white key"),
        (61, 63, (1, 2), 0, "thumb on black among black keys"),
        (60, 66, (1, 5), 2, "little finger on black after a white key"),
        (66, 60, (5, 1), 2, "little finger on black before a white key"),
        (61, 70, (1, 5), 0, "little finger on black among black keys"),
    ],
)
def test_the_colours_of_two_keys_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.colours, first, second, fingers) == expected, why


def test_weak_fingers_and_the_thumb_on_black_cost_the_published_points():
    assert PARNCUTT.single.tolist() == [[0, 0, 0, 1, 1], [1, 0, 0, 1, 1]]


@pytest.mark.parametrize(
    ("first", "third", "fingers", "half", "full"),
    [
        (60, 64, (1, 3), 0, 0),
        # A semitone beyond what is comfortable for 1-3, and not beyond what is practical.
        (60, 71, (1, 3), 1 + 1, 1 + 1),
        # Three semitones beyond comfortable, and one beyond practical.
        (60, 73, (1, 3), 1 + 3, 2 + 3),
        # Four semitones less than comfortable for 2-3, which have no practical way to pass.
        (64, 67, (3, 2), 1 + 4, 2 + 4),
        (60, 60, (2, 2), 0, 0),
    ],
)
def test_a_change_of_position_counts_once_or_twice_and_with_its_size(
    first, third, fingers, half, full
):
    assert points(PARNCUTT.shifts, first, third, fingers) == half
    assert points(PARNCUTT.full_shifts, first, third, fingers) == full


def test_only_the_three_outer_fingers_one_after_the_other_cost_a_point():
    found = {tuple(fingers) for fingers in np.argwhere(PARNCUTT.triples == 1.0)}
    assert found == set(itertools.permutations((2, 3, 4)))
    assert PARNCUTT.triples.sum() == 6


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("stretch", -1.0, "a finite number, 0 or more"),
        ("chord", float("nan"), "a finite number, 0 or more"),
        ("rest", float("inf"), "a finite number above 0"),
        ("leap", 0.0, "a finite number above 0"),
        ("physical", 1.5, "a finite number from 0 to 1"),
    ],
)
def test_a_weight_out_of_range_is_refused(name, value, expected):
    with pytest.raises(ConfigError, match=f"{name} is {value!r}: expected {expected}"):
        FingeringWeights(**{name: value})
