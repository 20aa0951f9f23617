"""The cost of a hand's states: its derivatives by finite differences, and what it objects to."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hand_parts import (
    SETTINGS,
    hand_of,
    keys_of,
    posture_of,
    random_positions,
    scene_of,
)

from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.planning.key_frames import key_frames
from sb3_piano.planning.leaps import TimedPress
from sb3_piano.planning.presses import Press

BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])
FAR = 10.0  # m
C4 = 39
UNCONCERNED = dataclasses.replace(
    SETTINGS, weight_idle=0.0, weight_wall=0.0, weight_spacing=0.0, weight_arms=0.0
)


def no_frames(n_states):
    return key_frames([], 1, n_states, np.zeros(5), keys_of(scene_of()), SETTINGS)


def cost_of(hand, frames, bound=None, settings=SETTINGS, full=True):
    kinematics = hand_of(scene_of(full=full), hand)
    n_states = len(frames.weight)
    if bound is None:
        bound = np.full(n_states, -kinematics.sign * FAR)
    return HandCost(kinematics, frames, settings, bound)


def busy_cost(hand, full=True, n_states=24):
    """Return a cost in which much is asked for, and positions where much of that is wrong."""
    scene = scene_of(full=full)
    kinematics, keys = hand_of(scene, hand), keys_of(scene)
    presses = [Press(C4 + 1, 1, 5, 8), Press(C4 + 5, 3, 7, 12), Press(C4 + 6, 4, 13, 20)]
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    frames = key_frames(timed, kinematics.sign, n_states, kinematics.radius, keys, SETTINGS)
    random = np.random.default_rng(hand)
    rest = posture_of(scene, hand).rest
    somewhere = random_positions(kinematics, n_states)
    share = random.uniform(0, 0.5, (n_states, 1))
    positions = (1 - share) * rest + share * somewhere
    positions[:, kinematics.index("forearm_tx")] *= 0.2  # near the keys of the presses
    bound = kinematics.arm(positions) + random.uniform(-0.02, 0.02, n_states)
    return cost_of(hand, frames, bound, full=full), positions


def changes_by_differences(cost, positions, directions, step=1e-6):
    """Return how the residuals change along some directions, by central differences."""
    return np.stack(
        [
            (cost.values(positions + step * way) - cost.values(positions - step * way)) / (2 * step)
            for way in directions
        ]
    )


@BOTH_HANDS
@pytest.mark.parametrize("full", [True, False])
def test_the_quadratic_model_is_that_of_finite_differences(hand, full):
    cost, positions = busy_cost(hand, full)
    hessian, gradient = cost.quadratic(positions)
    directions = np.random.default_rng(5).standard_normal((6, *positions.shape))
    changes = changes_by_differences(cost, positions, directions)
    expected = np.einsum("dsr,sr->ds", changes, cost.values(positions))
    found = np.einsum("dsn,sn->ds", directions, gradient)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    expected = np.einsum("dsr,esr->des", changes, changes)
    found = np.einsum("dsn,snm,esm->des", directions, hessian, directions)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@BOTH_HANDS
def test_these_states_have_something_of_everything_wrong_with_them(hand):
    """Else the test above would say nothing about it."""
    cost, positions = busy_cost(hand)
    gradient = cost.quadratic(positions)[1]
    kinds = {
        "targets": cost_of(hand, no_frames(len(positions)), cost.bound),
        "idle": dataclasses.replace(cost.settings, weight_idle=0.0),
        "wall": dataclasses.replace(cost.settings, weight_wall=0.0),
        "spacing": dataclasses.replace(cost.settings, weight_spacing=0.0),
        "arms": dataclasses.replace(cost.settings, weight_arms=0.0),
    }
    for name, without in kinds.items():
        other = without
        if not isinstance(other, HandCost):
            other = cost_of(hand, cost.frames, cost.bound, settings=without)
        assert np.abs(other.quadratic(positions)[1] - gradient).max() > 1e-6, name


def total(cost, positions):
    return float((cost.values(positions) ** 2).sum())


@BOTH_HANDS
def test_fingertips_that_play_nothing_are_kept_up(hand):
    rest = posture_of(scene_of(), hand).rest[None]
    height = hand_of(scene_of(), hand).fingertips(rest)[0, :, 2]
    assert np.ptp(height) < 1e-3
    without = dataclasses.replace(UNCONCERNED, idle_height=float(height.min()) - 0.001)
    assert total(cost_of(hand, no_frames(1), settings=without), rest) == 0
    for wanted in (height.min() - 0.001, height.min() + 0.01):
        options = dataclasses.replace(without, weight_idle=3.0, idle_height=float(wanted))
        expected = (9.0 * np.maximum(wanted - height, 0) ** 2).sum()
        idle = cost_of(hand, no_frames(1), settings=options)
        assert total(idle, rest) == pytest.approx(expected)
        frames = no_frames(1)
        frames.target[:] = hand_of(scene_of(), hand).fingertips(rest)
        frames.weight[:] = 1.0
        assert total(cost_of(hand, frames, settings=options), rest) == pytest.approx(0, abs=1e-12)


@BOTH_HANDS
def test_fingertips_at_their_targets_cost_nothing_and_others_their_distance(hand):
    rest = posture_of(scene_of(), hand).rest[None]
    frames = no_frames(1)
    frames.target[:] = hand_of(scene_of(), hand).fingertips(rest)
    frames.weight[0, 2] = [3.0, 5.0, 7.0]
    cost = cost_of(hand, frames, settings=UNCONCERNED)
    assert total(cost, rest) == pytest.approx(0, abs=1e-12)
    frames.target[0, 2] += [0.01, 0.02, 0.03]
    expected = (3 * 0.01) ** 2 + (5 * 0.02) ** 2 + (7 * 0.03) ** 2
    assert total(cost, rest) == pytest.approx(expected)
    frames.target[0, 1] += 1.0  # without weight, no target
    assert total(cost, rest) == pytest.approx(expected)


@BOTH_HANDS
def test_an_arm_beyond_its_bound_costs_by_how_far(hand):
    kinematics = hand_of(scene_of(), hand)
    rest = posture_of(scene_of(), hand).rest[None]
    arm = kinematics.arm(rest)
    # The right arm must be to the right of its bound, the left one to the left.
    within = cost_of(hand, no_frames(1), arm - kinematics.sign * 0.02)
    beyond = cost_of(hand, no_frames(1), arm + kinematics.sign * 0.02)
    np.testing.assert_allclose(within.bound_violation(rest), [0.0])
    np.testing.assert_allclose(beyond.bound_violation(rest), [0.02])
    expected = (SETTINGS.weight_arms * 0.02) ** 2
    assert total(beyond, rest) - total(within, rest) == pytest.approx(expected)


@BOTH_HANDS
def test_neighbouring_fingers_that_are_too_close_or_cross_cost_by_how_much(hand):
    kinematics = hand_of(scene_of(), hand)
    positions = posture_of(scene_of(), hand).rest[None].copy()
    positions[0, kinematics.index("FFJ4")] += 0.3
    y = kinematics.sign * kinematics.fingertips(positions)[0, :, 1]
    gaps = np.diff(y)
    assert np.ptp(gaps) > 0.003
    options = dataclasses.replace(
        UNCONCERNED, weight_spacing=3.0, spacing=0.025, thumb_spacing=0.035
    )
    least = np.array([0.035, 0.025, 0.025, 0.025])
    expected = (9.0 * np.maximum(least - gaps, 0) ** 2).sum()
    assert expected > 0
    found = total(cost_of(hand, no_frames(1), settings=options), positions)
    assert found == pytest.approx(expected)


@BOTH_HANDS
@pytest.mark.parametrize("playing", [True, False])
def test_a_fingertip_inside_the_row_of_black_keys_costs_unless_it_plays_one(hand, playing):
    kinematics = hand_of(scene_of(), hand)
    inside = posture_of(scene_of(), hand).rest[None].copy()
    along = kinematics.index("forearm_ty")  # towards the keys' hinges
    inside[0, along] = kinematics.high[along]
    frames = no_frames(1)
    frames.target[:] = kinematics.fingertips(inside)
    frames.weight[:] = float(playing)
    options = dataclasses.replace(UNCONCERNED, weight_wall=SETTINGS.weight_wall)
    costs = []
    for on_black in ([], [2], [0, 1, 2, 3, 4]):
        frames.on_black[0, on_black] = True
        costs.append(total(cost_of(hand, frames, settings=options), inside))
    assert costs[0] > costs[1] > costs[2] == 0


@BOTH_HANDS
def test_in_front_of_the_black_keys_or_above_them_fingertips_are_free(hand):
    kinematics = hand_of(scene_of(), hand)
    inside = posture_of(scene_of(), hand).rest[None].copy()
    along = kinematics.index("forearm_ty")
    inside[0, along] = kinematics.high[along]
    tips = kinematics.fingertips(inside)
    frames = no_frames(1)
    frames.target[:] = tips
    frames.weight[0] = 1.0
    walled = dataclasses.replace(UNCONCERNED, weight_wall=2.0)
    x = float(tips[0, :, 0].min())
    top = float((tips[0, :, 2] - kinematics.radius).min())
    in_front = dataclasses.replace(walled, wall_x=x - 1e-4)
    above = dataclasses.replace(walled, wall_height=top - 1e-4)
    assert total(cost_of(hand, frames, settings=walled), inside) > 0
    assert total(cost_of(hand, frames, settings=in_front), inside) == 0
    assert total(cost_of(hand, frames, settings=above), inside) == 0


def test_states_do_not_depend_on_each_other():
    cost, positions = busy_cost(0)
    moved = positions.copy()
    moved[4] += 0.1
    changed = (cost.values(moved) != cost.values(positions)).any(axis=1)
    assert np.flatnonzero(changed).tolist() == [4]
