"""The hand at rest: five fingertips over five white keys."""

from __future__ import annotations

import numpy as np
import pytest
from hand_parts import data_at, hand_of, keys_of, rest_of, scene_of, whole_hand

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering.robot import KEY_SPACING

EACH = pytest.mark.parametrize(("full", "hand"), [(True, 0), (True, 1), (False, 0), (False, 1)])


def fingertips(full, hand):
    scene = scene_of(full=full)
    return hand_of(scene, hand).fingertips(rest_of(scene, hand)[None])[0]


@EACH
def test_the_fingertips_are_over_neighbouring_white_keys(full, hand):
    scene = scene_of(full=full)
    keys, tips = keys_of(scene), fingertips(full, hand)
    sign = hand_of(scene, hand).sign
    np.testing.assert_allclose(np.diff(tips[:, 1]) * sign, KEY_SPACING, atol=0.002)
    top = keys.top[~KEY_IS_BLACK].max()
    lowest = tips[:, 2] - hand_of(scene, hand).radius
    assert (lowest > top + 0.003).all()
    assert (lowest < top + 0.03).all()


@EACH
def test_the_fingertips_are_in_front_of_the_black_keys(full, hand):
    scene = scene_of(full=full)
    data = data_at(scene)
    black, white = (scene.key_geom[colour == KEY_IS_BLACK] for colour in (True, False))
    front = (data.geom_xpos[:, 0] + scene.model.geom_size[:, 0])[black].max()
    edge = (data.geom_xpos[:, 0] + scene.model.geom_size[:, 0])[white].min()
    x = fingertips(full, hand)[:, 0]
    assert (x > front).all()
    assert (x < edge).all()


@EACH
def test_the_posture_is_within_the_control_ranges(full, hand):
    kinematics = hand_of(scene_of(full=full), hand)
    rest = rest_of(scene_of(full=full), hand)
    assert (rest >= kinematics.low).all()
    assert (rest <= kinematics.high).all()


@EACH
def test_a_hand_at_rest_touches_nothing(full, hand):
    scene = scene_of(full=full)
    rest = rest_of(scene, hand)
    data = data_at(scene, *((rest,) if hand == 0 else (np.zeros_like(rest), rest)))
    tips = set(scene.fingertip_geom[5 * hand : 5 * hand + 5].tolist())
    touching = {int(geom) for pair in data.contact.geom for geom in pair}
    assert not touching & tips


@pytest.mark.parametrize("full", [True, False])
def test_the_hands_are_mirror_images(full):
    right, left = fingertips(full, 0), fingertips(full, 1)
    np.testing.assert_allclose(right * [1, -1, 1], left, atol=0.002)


@EACH
def test_the_middle_of_the_hand_is_its_middle_finger(full, hand):
    middle = hand_of(scene_of(full=full), hand).middle
    assert middle == pytest.approx(fingertips(full, hand)[2, 1], abs=0.002)


def test_posture_is_held_by_all_but_the_slider_along_the_keys():
    hand = whole_hand(scene_of(), 0)
    along = hand.kinematics.index("forearm_tx")
    others = np.delete(hand.pull, along)
    assert hand.pull[along] < 0.1 * others.min()
