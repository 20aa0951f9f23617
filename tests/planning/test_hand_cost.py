"""The cost of a hand's states: its derivatives by finite differences, and what it objects to."""

import numpy as np
import pytest
from hand_parts import (
    SETTINGS,
    arm_of,
    data_at,
    hand_of,
    keys_of,
    random_positions,
    rest_of,
    scene_of,
)

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering.leaps import TimedPress
from sb3_piano.music.fingering.robot import KEY_SPACING
from sb3_piano.music.presses import Press
from sb3_piano.planning.hand_cost import HandCost
from sb3_piano.reading.key_frames import key_frames

BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])
FAR = 10.0  # m
C4 = 39
KINDS = {  # of a hand with five fingers
    "targets": slice(15),
    "idle": slice(15, 20),
    "wall": slice(20, 25),
    "spacing": slice(25, 29),
    "arms": 29,
}


def no_frames(n_states=1):
    return key_frames([], 1, n_states, np.zeros(5), keys_of(scene_of()), SETTINGS)


def cost_of(hand, frames, bound=None, full=True):
    kinematics = hand_of(scene_of(full=full), hand)
    if bound is None:
        bound = np.full(len(frames.weight), -kinematics.sign * FAR)
    return HandCost(kinematics, arm_of(scene_of(full=full), hand), frames, bound)


def total(cost, positions, kind=None):
    """Return the cost, or what one kind of residuals has in it."""
    values = cost.values(positions)
    return float(((values if kind is None else values[:, KINDS[kind]]) ** 2).sum())


def at_rest(hand):
    return rest_of(scene_of(), hand)[None].copy()


def busy_cost(hand, full=True, n_states=24):
    """Return a cost in which much is asked for, and positions where much of that is wrong."""
    scene = scene_of(full=full)
    kinematics, keys = hand_of(scene, hand), keys_of(scene)
    presses = [Press(C4 + 1, 1, 5, 8), Press(C4 + 5, 3, 7, 12), Press(C4 + 6, 4, 13, 20)]
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    frames = key_frames(timed, kinematics.sign, n_states, kinematics.radius, keys)
    random = np.random.default_rng(hand)
    share = random.uniform(0, 0.5, (n_states, 1))
    positions = (1 - share) * rest_of(scene, hand) + share * random_positions(kinematics, n_states)
    positions[:, kinematics.names.index("forearm_tx")] *= 0.2  # near the keys of the presses
    bound = arm_of(scene, hand).place(positions) + random.uniform(-0.02, 0.02, n_states)
    return cost_of(hand, frames, bound, full), positions


@BOTH_HANDS
@pytest.mark.parametrize("full", [True, False])
def test_the_quadratic_model_is_that_of_finite_differences(hand, full):
    cost, positions = busy_cost(hand, full)
    for kind in KINDS:  # else the test would say nothing about it
        assert total(cost, positions, kind) > 0, kind
    hessian, gradient = cost.quadratic(positions)
    ways, step = np.random.default_rng(5).standard_normal((6, *positions.shape)), 1e-6
    changes = np.stack(
        [
            (cost.values(positions + step * way) - cost.values(positions - step * way)) / (2 * step)
            for way in ways
        ]
    )
    expected = np.einsum("dsr,sr->ds", changes, cost.values(positions))
    found = np.einsum("dsn,sn->ds", ways, gradient)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
    expected = np.einsum("dsr,esr->des", changes, changes)
    found = np.einsum("dsn,snm,esm->des", ways, hessian, ways)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@BOTH_HANDS
@pytest.mark.parametrize("playing", [True, False])
def test_a_fingertip_inside_the_row_of_black_keys_costs_unless_it_plays_one(hand, playing):
    kinematics, inside = hand_of(scene_of(), hand), at_rest(hand)
    free = inside.copy()
    free[0, kinematics.names.index("forearm_ty")] = kinematics.low[
        kinematics.names.index("forearm_ty")
    ]
    # Towards the keys' hinges.
    inside[0, kinematics.names.index("forearm_ty")] = kinematics.high[
        kinematics.names.index("forearm_ty")
    ]
    frames = no_frames()
    frames.weight[:] = float(playing)
    assert total(cost_of(hand, frames), free, "wall") == 0, "in front of them"
    costs = []
    for on_black in ([], [2], [0, 1, 2, 3, 4]):
        frames.on_black[0, on_black] = True
        costs.append(total(cost_of(hand, frames), inside, "wall"))
    assert costs[0] > costs[1] > costs[2] == 0


# The hand at rest: five fingertips over five white keys.


EACH = pytest.mark.parametrize(("full", "hand"), [(True, 0), (True, 1), (False, 0), (False, 1)])


def fingertips(full, hand):
    scene = scene_of(full=full)
    return hand_of(scene, hand).fingertips(rest_of(scene, hand)[None])[0]


@EACH
def test_five_fingertips_hover_over_white_keys_in_front_of_the_black_ones(full, hand):
    scene = scene_of(full=full)
    kinematics, keys, tips = hand_of(scene, hand), keys_of(scene), fingertips(full, hand)
    np.testing.assert_allclose(np.diff(tips[:, 1]) * kinematics.sign, KEY_SPACING, atol=0.002)
    assert kinematics.middle == pytest.approx(tips[2, 1], abs=0.002)
    height = tips[:, 2] - kinematics.radius - keys.top[~KEY_IS_BLACK].max()
    assert ((height > 0.003) & (height < 0.03)).all()
    near_ends = data_at(scene).geom_xpos[:, 0] + scene.model.geom_size[:, 0]
    black, white = (near_ends[scene.key_geom[colour == KEY_IS_BLACK]] for colour in (True, False))
    assert ((tips[:, 0] > black.max()) & (tips[:, 0] < white.min())).all()


@EACH
def test_the_posture_is_within_the_control_ranges_and_touches_nothing(full, hand):
    scene = scene_of(full=full)
    kinematics, rest = hand_of(scene, hand), rest_of(scene, hand)
    assert ((rest >= kinematics.low) & (rest <= kinematics.high)).all()
    data = data_at(scene, *((rest,) if hand == 0 else (np.zeros_like(rest), rest)))
    tips = set(scene.fingertip_geom[5 * hand : 5 * hand + 5].tolist())
    assert not tips & set(data.contact.geom.ravel().tolist())


@pytest.mark.parametrize("full", [True, False])
def test_the_hands_are_mirror_images(full):
    right, left = fingertips(full, 0), fingertips(full, 1)
    np.testing.assert_allclose(right * [1, -1, 1], left, atol=0.002)
