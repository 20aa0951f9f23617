"""Reward terms: values worked by hand, empty cases, and dm_control's tolerance."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import rewards


def keys(*on):
    array = np.zeros(88, dtype=bool)
    array[list(on)] = True
    return array


def states(**depth):
    array = np.zeros(88)
    for key, value in depth.items():
        array[int(key[1:])] = value
    return array


def test_tolerance_equals_dm_controls():
    dm_tolerance = pytest.importorskip("dm_control.utils.rewards").tolerance
    x = np.linspace(-2, 3, 101)
    expected = dm_tolerance(x, bounds=(0, 0.05), margin=0.5, sigmoid="gaussian")
    ours = [rewards.tolerance(distance, 0.05, 0.5) for distance in x.tolist()]
    np.testing.assert_allclose(ours, expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("due", "state", "sounding", "expected"),
    [
        (keys(), states(), keys(), 0.5),  # silence where nothing is due
        (keys(), states(k3=1.0), keys(3), 0.0),  # a wrong key
        (keys(3), states(k3=1.0), keys(3), 1.0),
        (keys(3), states(k3=0.95), keys(3), 1.0),  # within the tolerance
        (keys(3), states(k3=0.45), keys(), 0.5 + 0.5 * 0.1),  # one margin outside it
        (keys(3, 4), states(k3=1.0, k4=0.45), keys(3), 0.5 + 0.5 * 0.55),
        (keys(3), states(k3=1.0, k4=1.0), keys(3, 4), 0.5),  # right and wrong
    ],
)
def test_key_press_of_hand_worked_cases(due, state, sounding, expected):
    wrong = bool((sounding & ~due).any())
    assert rewards.key_press(np.flatnonzero(due), state, wrong) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("due", "pressed", "expected"),
    [
        (False, False, 1.0),
        (True, True, 1.0),
        (True, False, 0.1 ** (1.9**2)),  # 0.95 outside, margin 0.5
        (False, True, 0.1 ** (2.0**2)),  # 1 below, margin 0.5
    ],
)
def test_sustain_of_all_four_cases(due, pressed, expected):
    assert rewards.sustain(due, pressed) == pytest.approx(expected)


def test_energy_is_minus_the_sum_of_powers_whatever_their_signs():
    assert rewards.energy(np.array([2.0, -3.0]), np.array([-1.0, 0.5])) == -3.5


def test_a_labelled_finger_earns_all_within_a_centimetre_and_a_tenth_eleven_centimetres_off():
    assert rewards.labelled_fingering([0.01]) == 1.0
    assert rewards.labelled_fingering([0.01, 0.11]) == pytest.approx((1.0 + 0.1) / 2)


def test_optimal_transport_takes_the_cheapest_assignment_not_the_first():
    tips = np.full((10, 3), 5.0)
    tips[7], tips[2] = [0, 0, 0], [0, 0.3, 0]
    press = np.array([[0, 0.3, 0], [0, 0, 0]])
    assert rewards.optimal_transport_fingering(tips, press) == 1.0
    many = np.zeros((12, 3))  # of more keys than fingers the ten nearest count
    many[10:] = 9.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), many) == 1.0


def test_fingering_terms_where_nothing_is_due():
    nothing = np.zeros((0, 3))
    assert rewards.labelled_fingering([]) == 0.0
    assert rewards.optimal_transport_fingering(np.zeros((10, 3)), nothing) == 1.0


def test_the_highest_return_is_that_of_every_term_at_its_upper_end():
    """Ten steps, in eight of them a key is due, in five of those with a finger label.

    Pressing keys earns 1 in eight steps and 0.5 in two, the pedal 1 in ten, fingering 1 in five,
    the forearms 1 in ten: with weights of 1, 2, 0.5 and 0.5 that is 9 + 20 + 2.5 + 5.
    """
    weights = {"key_press": 1.0, "sustain": 2.0, "energy": 0.005, "fingering": 0.5, "forearm": 0.5}
    counts = {"n_steps": 10, "n_due": 8, "n_fingering": 5}
    assert rewards.highest_return(weights, **counts, forearm=True) == pytest.approx(36.5)
    assert rewards.highest_return(weights, **counts, forearm=False) == pytest.approx(31.5)
    negative = {**weights, "sustain": -2.0}
    assert rewards.highest_return(negative, **counts, forearm=True) == pytest.approx(16.5)
