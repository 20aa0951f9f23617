"""Corrections: what the actuators are told where hands are beside their plan."""

from __future__ import annotations

import numpy as np
import pytest
from hand_parts import hand_of, scene_of
from short_pieces import five_fingers, planned

from sb3_piano.planning.correction import Correction

SCENE = scene_of()
HAND = hand_of(SCENE, 0)
LIFT, STEP = 0.002, 14  # so small that it is linear
OF_RING_FINGER = [i for i, name in enumerate(HAND.names) if name.startswith("RF")]


@pytest.fixture(scope="module")
def made():
    return planned(five_fingers())


def aside(made, distance):
    """Return a turn of the ring finger's knuckle that takes its tip aside by so much, m."""
    knuckle, ahead = HAND.index("RFJ4"), np.zeros(SCENE.model.nu)
    _, slopes = HAND.fingertips_and_jacobian(made.hands[0].positions[[STEP]])
    ahead[knuckle] = distance / slopes[0, 3, 1, knuckle]
    return ahead


def lifted(made, ahead):
    """Return what a lift adds to the feedback, (n,) of the right hand."""
    with_lift, without = (Correction(made.hands, 1.0, lift) for lift in (LIFT, 0.0))
    return (with_lift(STEP, ahead) - without(STEP, ahead))[: HAND.size]


def test_a_fingertip_far_to_the_side_is_lifted_by_its_own_joints(made):
    change = lifted(made, aside(made, 0.03))
    others = np.setdiff1d(np.arange(HAND.size), OF_RING_FINGER)
    assert not change[others].any()
    posture = made.hands[0].positions[STEP]
    tips = HAND.fingertips(np.stack([posture, posture + change]))
    assert tips[1, 3, 2] - tips[0, 3, 2] == pytest.approx(LIFT, rel=0.2)


def test_it_is_lifted_more_the_farther_it_is(made):
    sizes = [np.abs(lifted(made, aside(made, d))).max() for d in (0.009, 0.011, 0.02, 0.03)]
    assert 0 < sizes[0] < sizes[1] < sizes[2]
    assert sizes[2] == pytest.approx(sizes[3])


def test_near_its_place_no_fingertip_is_lifted(made):
    assert not lifted(made, aside(made, 0.004)).any()


def test_many_hands_are_corrected_as_each_alone(made):
    correction = Correction(made.hands, 1.5, LIFT)
    ahead = np.random.default_rng(0).uniform(-0.3, 0.3, (6, SCENE.model.nu))
    alone = np.stack([correction(STEP, one) for one in ahead])
    np.testing.assert_allclose(correction(STEP, ahead), alone, atol=1e-6)


def test_positions_are_those_of_fingers_that_bend_evenly(made):
    low, high = np.concatenate(SCENE.joint_range).T
    joints = low + (high - low) * np.random.default_rng(1).uniform(0.2, 0.9, len(low))
    positions = Correction(made.hands, 1.0, LIFT).positions(joints)
    for hand, (found, part) in enumerate(
        zip(np.split(positions, 2), np.split(joints, 2), strict=True)
    ):
        np.testing.assert_array_equal(found, hand_of(SCENE, hand).even_positions(part))
    assert np.abs(positions - SCENE.actuator_positions(joints)).max() > 0.01
