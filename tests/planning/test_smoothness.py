"""Smoothness, against sums and matrices written out."""

from __future__ import annotations

import numpy as np
import pytest
from hand_parts import SETTINGS, hand_of, scene_of

from sb3_piano.planning.smoothness import Smoothness

KINEMATICS = hand_of(scene_of(), 1)
SIZE = KINEMATICS.size


def jerk_of(name):
    if name == "forearm_tx":
        return SETTINGS.jerk_along
    if name == "forearm_ty":
        return SETTINGS.jerk_inwards
    return SETTINGS.jerk_wrist if name.startswith("WRJ") else SETTINGS.jerk_finger


def smoothness_of(n_states, seed=0):
    random = np.random.default_rng(seed)
    before = random.standard_normal((2, SIZE))
    return (
        Smoothness(KINEMATICS, SETTINGS, before, n_states),
        before,
        random.standard_normal((n_states, SIZE)),
    )


def cost_by_hand(before, positions):
    """Add up what changes of place and of velocity cost, number by number."""
    total = 0.0
    way = [*before, *positions]
    for s in range(2, len(way)):
        for actuator, name in enumerate(KINEMATICS.names):
            here, one_back, two_back = (way[s - back][actuator] for back in (0, 1, 2))
            total += (SETTINGS.velocity * (here - one_back)) ** 2
            total += (jerk_of(name) * (here - 2 * one_back + two_back)) ** 2
    return total


def dense(band, size):
    """Return the symmetric matrix of lower diagonals."""
    n = band.shape[1]
    matrix = np.zeros((n, n))
    for below, diagonal in enumerate(band):
        for column in range(n - below):
            matrix[column + below, column] = matrix[column, column + below] = diagonal[column]
    assert len(band) == 2 * size + 1
    return matrix


@pytest.mark.parametrize("n_states", [1, 2, 3, 6])
def test_the_cost_is_the_sum_over_all_states_and_actuators(n_states):
    smoothness, before, positions = smoothness_of(n_states)
    assert smoothness.cost(positions) == pytest.approx(cost_by_hand(before, positions))


@pytest.mark.parametrize("n_states", [1, 2, 3, 6])
def test_the_gradient_is_that_of_half_the_cost(n_states):
    smoothness, before, positions = smoothness_of(n_states)
    gradient = smoothness.gradient(positions)
    assert gradient.shape == positions.shape
    for seed in range(5):  # of a quadratic form, central differences are exact
        way = np.random.default_rng(10 + seed).standard_normal(positions.shape)
        rise = cost_by_hand(before, positions + way) - cost_by_hand(before, positions - way)
        assert (gradient * way).sum() == pytest.approx(rise / 4)


@pytest.mark.parametrize("n_states", [1, 2, 3, 6])
def test_the_band_is_the_hessian_of_half_the_cost(n_states):
    smoothness, *_ = smoothness_of(n_states)
    differences = np.eye(n_states + 2)
    first = np.diff(differences, axis=0)[1:, 2:]
    second = np.diff(differences, n=2, axis=0)[:, 2:]
    expected = np.zeros((n_states * SIZE, n_states * SIZE))
    for actuator, name in enumerate(KINEMATICS.names):
        matrix = SETTINGS.velocity**2 * first.T @ first + jerk_of(name) ** 2 * second.T @ second
        expected[actuator::SIZE, actuator::SIZE] = matrix
    np.testing.assert_allclose(dense(smoothness.band, SIZE), expected, atol=1e-15)


def test_the_states_before_count():
    smoothness, before, positions = smoothness_of(4)
    straight_on = before[1] + np.arange(1, 5)[:, None] * (before[1] - before[0])
    speed = ((SETTINGS.velocity * (before[1] - before[0])) ** 2).sum()
    assert smoothness.cost(straight_on) == pytest.approx(4 * speed)
    assert smoothness.cost(positions) > 4 * speed


def test_standing_still_costs_nothing():
    still = np.ones((2, SIZE))
    smoothness = Smoothness(KINEMATICS, SETTINGS, still, 5)
    assert smoothness.cost(np.ones((5, SIZE))) == 0
    assert not smoothness.gradient(np.ones((5, SIZE))).any()
