"""Random changes: how large, where, and how they go on."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.planning.sampling.noise import Candidates, SamplingNoise
from sb3_piano.simulation import compile_scene

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


def test_no_more_knots_are_drawn_than_there_are_control_steps():
    assert candidates(horizon=3, knots=9).none().shape == (3, NU)


def test_a_step_later_a_change_goes_on_where_it_was_and_holds_at_its_end():
    drawing = candidates(horizon=4, knots=4, decay=1.0)
    knots = drawing.draw(1, np.random.default_rng(0))[0]
    later = drawing.over_horizon(drawing.shifted(knots)[None])[0]
    before = drawing.over_horizon(knots[None])[0]
    np.testing.assert_allclose(later, before[[1, 2, 3, 3]])


def test_with_few_knots_it_goes_on_as_it_was_at_their_times():
    drawing = candidates(horizon=5, knots=2, decay=0.5)
    knots = drawing.draw(1, np.random.default_rng(0))[0]
    before = drawing.over_horizon(knots[None])[0]
    np.testing.assert_allclose(drawing.shifted(knots), 0.5 * before[[1, 4]])
