"""How near forearms that turn come to each other: against MuJoCo's shapes and contacts."""

import numpy as np
import pytest
from hand_parts import arm_of, data_at, hand_of, random_positions, scene_of
from hypothesis import given
from hypothesis import strategies as st

from sb3_piano.hands import find_hand
from sb3_piano.reading.piece import bounds_of, dividing_line

FOREARM_DOFS = tuple(find_hand().forearm.joints.values())

TURNING = ("forearm_tx", "forearm_ty", "forearm_yaw")
BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])


def inner_side(scene, data, hand):
    """Return how far inside, towards the other forearm, a forearm's hull reaches, m."""
    model, (hull, *_) = scene.model, scene.forearm_geoms[hand]
    mesh = model.geom_dataid[hull]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count] @ data.geom_xmat[hull].reshape(3, 3).T
    across = corners[:, 1] + data.geom_xpos[hull, 1]
    return across.min() if hand == 0 else across.max()


@BOTH_HANDS
@pytest.mark.parametrize("dofs", [TURNING, FOREARM_DOFS], ids=["yaw", "all"])
def test_a_turned_arm_is_where_a_straight_one_would_reach_as_far_inwards(hand, dofs):
    scene = scene_of(full=False, forearm_dofs=dofs)
    kinematics = hand_of(scene, hand)
    thickness = abs(inner_side(scene, data_at(scene), hand) - kinematics.middle)
    positions = random_positions(kinematics, 20)
    for place, one in zip(arm_of(scene, hand).place(positions), positions, strict=True):
        both = (one,) if hand == 0 else (np.zeros_like(one), one)
        inner = inner_side(scene, data_at(scene, *both), hand)
        # One that is pitched up and rolled leans to the side by up to 7 mm.
        exact = 1e-7 if dofs == TURNING else 8e-3
        assert place == pytest.approx(inner + kinematics.sign * thickness, abs=exact)


@BOTH_HANDS
def test_the_slopes_of_a_turned_arm_are_those_of_its_place(hand):
    scene = scene_of(full=False, forearm_dofs=TURNING)
    kinematics, arm = hand_of(scene, hand), arm_of(scene, hand)
    positions = random_positions(kinematics, 10)
    slopes = arm.slopes(positions)
    for actuator in range(kinematics.size):
        step = np.zeros(kinematics.size)
        step[actuator] = 1e-6
        ahead, behind = arm.place(positions + step), arm.place(positions - step)
        np.testing.assert_allclose(slopes[:, actuator], (ahead - behind) / 2e-6, atol=1e-6)


def test_arms_on_their_sides_of_a_line_do_not_touch_and_hands_come_nearer_than_arms_are_thick():
    scene = scene_of(full=False, forearm_dofs=TURNING)
    right, left = hand_of(scene, 0), hand_of(scene, 1)
    random, nearest = np.random.default_rng(1), np.inf
    yaw, along = right.names.index("forearm_yaw"), right.names.index("forearm_tx")
    for _ in range(200):
        here, there = np.zeros((1, right.size)), np.zeros((1, left.size))
        here[0, yaw], there[0, yaw] = random.uniform(right.low[yaw], right.high[yaw], 2)
        for hand, one, place in ((0, here, 0.076), (1, there, -0.076)):
            away = place - arm_of(scene, hand).place(one)[0]
            one[0, along] += away / hand_of(scene, hand).slope
        data = data_at(scene, here[0], there[0])
        assert not scene.forearms_touch(data)
        tips = data.site_xpos[scene.fingertip_site, 1]
        nearest = min(nearest, abs(tips[2] - tips[7]))
    assert nearest < 0.1 < 2 * 0.076


# The line between the arms: who gives way to whom.


APART = 0.16  # m

places = st.floats(-0.6, 0.6, allow_nan=False)


def bounds(right, left, right_busy, left_busy):
    """Return the bounds of the two arms in one state."""
    line = dividing_line(
        [np.array([right]), np.array([left])],
        [np.array([right_busy]), np.array([left_busy])],
        APART,
    )
    right_bound, left_bound = bounds_of(line, APART)
    return float(right_bound[0]), float(left_bound[0])


@given(places, places, st.booleans(), st.booleans())
def test_the_bounds_keep_the_arms_apart_the_right_one_to_the_right(right, left, busy, other_busy):
    right_bound, left_bound = bounds(right, left, busy, other_busy)
    assert right_bound - left_bound == pytest.approx(APART)


@given(places, places, st.booleans())
def test_a_hand_that_plays_is_not_pushed_by_one_that_rests(right, left, right_plays):
    right_bound, left_bound = bounds(right, left, right_plays, not right_plays)
    if right_plays:
        assert right_bound <= right + 1e-9
    else:
        assert left_bound >= left - 1e-9


@given(places, places)
def test_two_hands_that_play_share_what_is_missing(right, left):
    right_bound, left_bound = bounds(right, left, True, True)
    pushed_right, pushed_left = max(right_bound - right, 0), max(left - left_bound, 0)
    assert pushed_right == pytest.approx(pushed_left, abs=1e-9)
    assert pushed_right + pushed_left == pytest.approx(max(left + APART - right, 0), abs=1e-9)
