"""The tracker: the plan's commands, corrected by where the hands are."""

import numpy as np
import pytest
from hand_parts import hand_of, scene_of
from short_pieces import five_fingers, planned

from sb3_piano.planning import Tracker
from sb3_piano.planning.bends import EvenBends
from sb3_piano.planning.correction import Correction

SCENE = scene_of()
HALF = SCENE.model.nu // 2
HAND = hand_of(SCENE, 0)
LIFT, STEP = 0.002, 14  # so small that it is linear
OF_RING_FINGER = [i for i, name in enumerate(HAND.names) if name.startswith("RF")]


@pytest.fixture(scope="module")
def made():
    return planned(five_fingers())


def test_on_its_plan_a_hand_is_told_what_was_planned(made):
    tracker = Tracker(made, SCENE, 0.5)
    for step in (0, 5, len(made) - 1):
        told = tracker.controls(step, made.positions[step])
        np.testing.assert_allclose(told, made.commands[step], atol=1e-12)


def test_a_hand_that_is_ahead_is_told_to_go_less_far_by_the_share_of_the_gains(made):
    random = np.random.default_rng(0)
    tracker, whole = Tracker(made, SCENE, 0.25), Tracker(made, SCENE, 1.0)
    for step in (3, 11, 20):
        ahead = random.uniform(-1e-4, 1e-4, SCENE.model.nu)
        change = whole.controls(step, made.positions[step] + ahead) - made.commands[step]
        quarter = tracker.controls(step, made.positions[step] + ahead) - made.commands[step]
        inside = (made.commands[step] > SCENE.ctrl_low + 0.01) & (
            made.commands[step] < SCENE.ctrl_high - 0.01
        )
        for hand in (0, 1):
            part = slice(hand * HALF, (hand + 1) * HALF)
            expected = -made.hands[hand].gains[step] @ ahead[part]
            np.testing.assert_allclose(
                change[part][inside[part]], expected[inside[part]], atol=1e-10
            )
        np.testing.assert_allclose(quarter[inside], change[inside] / 4, atol=1e-10)


def test_commands_stay_in_the_control_ranges_however_far_off_hands_are(made):
    tracker = Tracker(made, SCENE, 1.0)
    random = np.random.default_rng(1)
    told = tracker.controls(9, random.uniform(-50, 50, (20, SCENE.model.nu)))
    assert (told >= SCENE.ctrl_low).all()
    assert (told <= SCENE.ctrl_high).all()
    assert ((told == SCENE.ctrl_low) | (told == SCENE.ctrl_high)).any()


def test_after_the_last_step_the_last_one_goes_on(made):
    tracker = Tracker(made, SCENE, 0.5)
    np.testing.assert_array_equal(
        tracker.controls(len(made) + 7, made.positions[3]),
        tracker.controls(len(made) - 1, made.positions[3]),
    )


# Corrections: what the actuators are told where hands are beside their plan.


def aside(made, distance):
    """Return a turn of the ring finger's knuckle that takes its tip aside by so much, m."""
    knuckle, ahead = HAND.names.index("RFJ4"), np.zeros(SCENE.model.nu)
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
    assert not lifted(made, aside(made, 0.004)).any()
    assert 0 < sizes[0] < sizes[1] < sizes[2]
    assert sizes[2] == pytest.approx(sizes[3])


def test_positions_are_those_of_fingers_that_bend_evenly(made):
    low, high = np.concatenate(SCENE.joint_range).T
    joints = low + (high - low) * np.random.default_rng(1).uniform(0.2, 0.9, len(low))
    positions = Correction(made.hands, 1.0, LIFT).positions(joints)
    for hand, (found, part) in enumerate(
        zip(np.split(positions, 2), np.split(joints, 2), strict=True)
    ):
        np.testing.assert_array_equal(found, EvenBends(hand_of(SCENE, hand))(part))
    assert np.abs(positions - SCENE.actuator_positions(joints)).max() > 0.01
