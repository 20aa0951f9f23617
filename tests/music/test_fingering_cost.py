"""The costs of fingers on keys, against the rules as published and worked by hand."""

import itertools

import numpy as np
import pytest
from published_rules import PARNCUTT_HAND, PARNCUTT_WEIGHTS
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.cost import MAX_INTERVAL, CostTables, FingeringWeights

tables = Tables(__file__)
PARNCUTT = CostTables(PARNCUTT_WEIGHTS, PARNCUTT_HAND)


def points(table, first, second, fingers):
    """The cost of two pitches with two fingers, numbered as pianists do."""
    at = (first % 12, second - first + MAX_INTERVAL, fingers[0] - 1, fingers[1] - 1)
    return pytest.approx(float(table[at]), rel=1e-5, abs=1e-5)


@tables("first, second, fingers, expected, why")
def test_two_keys_in_succession_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.moves, first, second, fingers) == expected, why


@tables("first, second, fingers, expected, why")
def test_the_colours_of_two_keys_cost_the_published_points(first, second, fingers, expected, why):
    assert points(PARNCUTT.colours, first, second, fingers) == expected, why


def test_weak_fingers_and_the_thumb_on_black_cost_the_published_points():
    assert PARNCUTT.single.tolist() == [[0, 0, 0, 1, 1], [1, 0, 0, 1, 1]]


@tables("first, third, fingers, half, full")
def test_a_change_of_position_counts_once_or_twice_and_with_its_size(
    first, third, fingers, half, full
):
    assert points(PARNCUTT.shifts, first, third, fingers) == half
    assert points(PARNCUTT.full_shifts, first, third, fingers) == full


def test_only_the_three_outer_fingers_one_after_the_other_cost_a_point():
    found = {tuple(fingers) for fingers in np.argwhere(PARNCUTT.triples == 1.0)}
    assert found == set(itertools.permutations((2, 3, 4)))
    assert PARNCUTT.triples.sum() == 6


@tables("name, value, expected")
def test_a_weight_out_of_range_is_refused(name, value, expected):
    with pytest.raises(ConfigError, match=f"{name} is {value!r}: expected {expected}"):
        FingeringWeights(**{name: value})
