"""What candidates cost where it does not follow from a simulation: see `test_sampling_search`."""

import itertools

import numpy as np
import pytest

from sb3_piano.exceptions import ConfigError
from sb3_piano.planning.sampling.cost import SamplingCost, wrong_keys
from sb3_piano.planning.sampling.noise import Candidates, SamplingNoise
from sb3_piano.simulation import compile_scene

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


# Random changes: how large, where, and how they go on.


SCENE = compile_scene(physics="fast")
NU = SCENE.model.nu
NAMES = [SCENE.model.actuator(a).name.rsplit("/")[-1] for a in range(NU)]
WRISTS = [a for a, name in enumerate(NAMES) if "WRJ" in name]
FOREARMS = [a for a, name in enumerate(NAMES) if name.startswith("forearm")]
FINGERS = [a for a in range(NU) if a not in WRISTS + FOREARMS]


def candidates(horizon=6, **noise):
    return Candidates(SamplingNoise(**noise), SCENE, horizon)


def test_each_kind_of_actuator_has_its_own_noise():
    drawn = candidates(share=1, finger=0.2, wrist=0.05, forearm=0.01).draw(
        3000, np.random.default_rng(0)
    )
    assert len(WRISTS) == len(FOREARMS) == 4
    for actuators, expected in ((FINGERS, 0.2), (WRISTS, 0.05), (FOREARMS, 0.01)):
        np.testing.assert_allclose(drawn[:, :, actuators].std(axis=0), expected, rtol=0.08)
    np.testing.assert_allclose(drawn.mean(axis=0), 0, atol=0.02)


def test_only_a_share_of_the_actuators_is_changed_and_those_at_all_knots():
    drawn = candidates(share=0.3, knots=3).draw(2000, np.random.default_rng(0))
    changed = drawn != 0
    assert (changed.all(axis=1) == changed.any(axis=1)).all()
    np.testing.assert_allclose(changed.mean(axis=(0, 1)), 0.3, atol=0.05)


def test_changes_are_straight_lines_between_knots():
    knots = np.zeros((1, 3, NU))
    knots[0, :, 5] = [1.0, 2.0, -1.0]
    change = candidates(horizon=5, knots=3).over_horizon(knots)
    assert change.shape == (1, 5, NU)
    np.testing.assert_allclose(change[0, :, 5], [1.0, 1.5, 2.0, 0.5, -1.0])
    assert not change[0, :, :5].any()


@pytest.mark.parametrize(("knots", "horizon"), [(1, 4), (2, 1), (3, 1)])
def test_a_single_knot_is_a_constant_change(knots, horizon):
    drawing = candidates(horizon=horizon, knots=knots)
    drawn = drawing.draw(2, np.random.default_rng(0))
    assert drawn.shape == (2, 1, NU)
    expected = np.repeat(drawn, horizon, axis=1)
    np.testing.assert_array_equal(drawing.over_horizon(drawn), expected)


@pytest.mark.parametrize(
    ("horizon", "n_knots", "decay", "kept"),
    [(4, 9, 1.0, [1, 2, 3, 3]), (5, 2, 0.5, [1, 4])],
    ids=["at each step", "few knots"],
)
def test_a_step_later_a_change_goes_on_where_it_was_and_holds_at_its_end(
    horizon, n_knots, decay, kept
):
    drawing = candidates(horizon=horizon, knots=n_knots, decay=decay)
    assert drawing.none().shape == (min(horizon, n_knots), NU)
    knots = drawing.draw(1, np.random.default_rng(0))[0]
    before = drawing.over_horizon(knots[None])[0]
    np.testing.assert_allclose(drawing.shifted(knots), decay * before[kept])
