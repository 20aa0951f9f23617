"""The tracker: the plan's commands, corrected by where the hands are."""

from __future__ import annotations

import numpy as np
import pytest
from hand_parts import scene_of
from short_pieces import five_fingers, planned

from sb3_piano.planning import Tracker

SCENE = scene_of(full=False)
HALF = SCENE.model.nu // 2


@pytest.fixture(scope="module")
def made():
    return planned(five_fingers(), full=False)


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


def test_many_hands_are_told_the_same_as_each_alone(made):
    tracker = Tracker(made, SCENE, 0.5)
    random = np.random.default_rng(2)
    positions = made.positions[9] + random.uniform(-0.1, 0.1, (5, SCENE.model.nu))
    together = tracker.controls(9, positions)
    assert together.shape == positions.shape
    alone = np.stack([tracker.controls(9, one) for one in positions])
    np.testing.assert_allclose(together, alone, atol=1e-12)


def test_after_the_last_step_the_last_one_goes_on(made):
    tracker = Tracker(made, SCENE, 0.5)
    np.testing.assert_array_equal(
        tracker.controls(len(made) + 7, made.positions[3]),
        tracker.controls(len(made) - 1, made.positions[3]),
    )
