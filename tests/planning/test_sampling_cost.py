"""What candidates cost where it does not follow from a simulation: see `test_sampling_search`."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.planning.sampling.noise import SamplingNoise

NOTHING = {
    "missed": 0, "wrong": 0, "reluctant": 0, "brushed": 0, "astray": 0, "distance": 0, "effort": 0
}  # fmt: skip
SOUNDING = np.full(88, 0.1)


def only(**weights):
    return SamplingCost(**{**NOTHING, **weights})


def keys(**angles):
    """Return angles of one candidate's keys, given as k40=0.1."""
    row = np.zeros((1, 88))
    for name, angle in angles.items():
        row[0, int(name[1:])] = angle
    return row


def due(*which):
    return np.isin(np.arange(88), which)


def test_in_silence_still_keys_cost_nothing():
    assert SamplingCost().key_cost(due(), keys(), SOUNDING).sum(axis=1) == pytest.approx([0.0])


def test_keys_that_cannot_sound_are_never_wrong():
    sounding = np.where(np.arange(88) == 41, np.inf, SOUNDING)
    angles = keys(k41=0.0)
    assert not SamplingCost().key_cost(due(), angles, sounding).any()
    cost = only(missed=1, reluctant=1).key_cost(due(41), angles, sounding)
    assert cost.sum(axis=1) == pytest.approx([2.0])


def test_actuators_without_noise_are_not_counted():
    deviation = np.array([0.1, 0.0])
    apart = np.array([[0.1, 0.7]])
    assert only(effort=2).effort_cost(apart, deviation) == pytest.approx([2])
    planned = only(astray=3, tolerance=1).plan_cost(np.zeros(2), apart, deviation)
    assert planned == pytest.approx([3])
    assert only(effort=2).effort_cost(apart, np.zeros(2)) == pytest.approx([0])


def test_any_fingers_cost_the_least_of_all_assignments():
    random = np.random.default_rng(3)
    tips, points = random.uniform(0, 0.1, (4, 10, 3)), random.uniform(0, 0.1, (4, 3, 3))
    cost = only(distance=1.5, reach=0.06)

    def far(offset):
        return 1 / (1 + 0.06 / np.linalg.norm(offset))

    expected = [
        min(
            1.5 * sum(far(t[f] - p) for f, p in zip(chosen, q, strict=True))
            for chosen in itertools.permutations(range(10), 3)
        )
        for t, q in zip(tips, points, strict=True)
    ]
    assert cost.any_finger_cost(tips, points) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("settings", "name", "value"),
    [
        (SamplingCost, "wrong", -1),
        (SamplingCost, "tolerance", 0),
        (SamplingCost, "discount", 1.01),
        (SamplingNoise, "share", 0),
        (SamplingNoise, "knots", 0),
        (SamplingNoise, "finger", -0.1),
        (SamplingNoise, "decay", 1.1),
    ],
)
def test_settings_out_of_range_are_named(settings, name, value):
    with pytest.raises(ConfigError, match=f"{name} is {value!r}: expected a "):
        settings(**{name: value})


def test_mistakes_are_keys_that_sound_undue_or_are_silent_though_due():
    candidates = np.concatenate([keys(), keys(k40=0.1, k44=0.2), keys(k40=0.2, k41=0.1, k7=0.09)])
    assert wrong_keys(due(40, 44), candidates, SOUNDING).tolist() == [2, 0, 2]
