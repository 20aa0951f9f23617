"""The hand at rest: five fingertips over five white keys."""

import numpy as np
import pytest
from hand_parts import data_at, hand_of, keys_of, rest_of, scene_of

from sb3_piano.music.constants import KEY_IS_BLACK
from sb3_piano.music.fingering.robot import KEY_SPACING

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
