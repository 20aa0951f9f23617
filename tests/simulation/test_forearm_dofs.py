"""The joints that a forearm may have: RoboPianist's numbers, and what follows from them."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hand_parts import data_at, hand_of, random_positions, scene_of

from sb3_piano.envs import PianoEnv
from sb3_piano.envs.actions import hand_action_unit
from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import find_hand
from sb3_piano.training.playing.player import OpenPlayer, stage_for
from sb3_piano.training.playing.takes import take_of

ALL = tuple(find_hand().forearm.joints.values())
TURNING = ("forearm_tx", "forearm_ty", "forearm_yaw")
NUMBERS = json.loads(
    (Path(__file__).parents[1] / "data" / "reference" / "forearms.json").read_text()
)


@pytest.mark.parametrize(
    "dofs", [*[("forearm_tx", *({n} - {"forearm_tx"})) for n in ALL], ALL], ids=str
)
def test_joints_and_servos_have_robopianists_numbers_and_its_order(dofs):
    scene = scene_of(full=False, forearm_dofs=dofs)
    for place, side in enumerate(("right", "left")):
        assert scene.joint_names[place][-len(dofs) :] == tuple(
            f"{side[0]}h_shadow_hand/{n}" for n in dofs
        )
        half = scene.model.nu // 2
        for at, name in enumerate(dofs):
            expected = NUMBERS[name][side]
            joint = scene.model.joint(f"{side[0]}h_shadow_hand/{name}")
            servo = scene.model.actuator(half * (place + 1) - len(dofs) + at)
            assert servo.name == joint.name
            slides = (
                mujoco.mjtJoint.mjJNT_SLIDE if expected["slides"] else mujoco.mjtJoint.mjJNT_HINGE
            )
            assert joint.type == slides
            np.testing.assert_allclose(joint.axis, expected["axis"], atol=1e-15)
            np.testing.assert_allclose(joint.range, expected["range"], atol=1e-15)
            np.testing.assert_allclose(servo.ctrlrange, expected["range"], atol=1e-15)
            assert joint.damping == pytest.approx(expected["damping"], rel=1e-12)
            assert servo.gainprm[0] == expected["gain"]


def test_by_default_forearms_slide_along_and_across_the_keyboard():
    assert find_hand().forearm_dofs() == ("forearm_tx", "forearm_ty")
    named = scene_of(full=False, forearm_dofs=find_hand().forearm_dofs())
    default = scene_of(full=False)
    sizes = [mujoco.mj_sizeModel(scene.model) for scene in (default, named)]
    one, other = (np.zeros(size, dtype=np.uint8) for size in sizes)
    mujoco.mj_saveModel(default.model, None, one)
    mujoco.mj_saveModel(named.model, None, other)
    np.testing.assert_array_equal(one, other)


def test_what_hands_read_is_laid_out_for_forearms_that_slide():
    with pytest.raises(ConfigError, match=r"forearm_dofs is .*'hands', .*the sight-reader"):
        PianoEnv("CMajorScaleTwoHands", observation="hands", forearm_dofs=TURNING)
    stage = stage_for("TwinkleTwinkle", forearm_dofs=("forearm_tx", "forearm_yaw"))  # as many
    with (
        pytest.raises(ConfigError, match=r"expected \['forearm_tx', 'forearm_ty'\]"),
        OpenPlayer.open("sight-reader", stage) as player,
    ):
        take_of(player)
    PianoEnv("CMajorScaleTwoHands", observation="hands", forearm_dofs=["forearm_tx", "forearm_ty"])


def test_each_joint_is_an_action_and_an_observed_number_of_each_hand_and_is_named():
    plain, turning = (PianoEnv("CMajorScaleTwoHands", forearm_dofs=d) for d in (None, TURNING))
    assert turning.action_space.shape[0] == plain.action_space.shape[0] + 2
    assert turning.observation_space.shape[0] == plain.observation_space.shape[0] + 2
    block = turning.observation_layout["left_joints"]
    assert block.meaning.endswith("wrist to thumb, then forearm_tx, forearm_ty, forearm_yaw")
    assert "forearm_yaw" in turning.config.simulation
    assert "forearm" not in plain.config.simulation


def test_what_a_joint_moves_is_told_by_its_role():
    kinds = dict(
        zip(
            hand_of(scene_of(forearm_dofs=ALL), 0).names,
            scene_of(forearm_dofs=ALL).actuator_kind,
            strict=False,
        )
    )
    assert {kinds[name] for name in ALL[:3]} == {"forearm"}
    assert {kinds[name] for name in ALL[3:]} == {"elbow"}
    assert (kinds["WRJ1"], kinds["THJ4"]) == ("wrist", "finger")


def test_offsets_of_right_hands_move_left_ones_in_the_mirror():
    scene = scene_of(full=False, forearm_dofs=ALL)
    right, left = hand_of(scene, 0), hand_of(scene, 1)
    sign = np.sign(hand_action_unit(scene)).reshape(2, -1)
    offset = 0.5 * random_positions(right, 6)
    assert (sign[0] == 1).all()
    mirrored = left.fingertips(offset * sign[1]) * [1, -1, 1]
    np.testing.assert_allclose(right.fingertips(offset * sign[0]), mirrored, rtol=0, atol=1e-4)


@pytest.mark.parametrize("dofs", [None, ALL], ids=["sliding", "turning"])
@pytest.mark.parametrize("physics", ["reference", "fast"])
def test_forearms_touch_where_mujoco_finds_a_contact_of_theirs(physics, dofs):
    scene = scene_of(full=False, physics=physics, forearm_dofs=dofs)
    forearm = [scene.model.body(f"{side}h_shadow_hand/{side}h_forearm").id for side in "rl"]
    right, left = (random_positions(hand_of(scene, hand), 60, seed=hand) for hand in (0, 1))
    along = hand_of(scene, 0).along  # the hands meet, and pass each other
    right[:, along] = np.random.default_rng(2).uniform(-0.4, 0.1, 60)
    left[:, along] = 0.0
    found = []
    for one, other in zip(right, left, strict=True):
        data = data_at(scene, one, other)
        bodies = scene.model.geom_bodyid[data.contact.geom]
        found.append(any(sorted(pair) == sorted(forearm) for pair in bodies.tolist()))
        assert scene.forearms_touch(data) == found[-1]
    assert 4 < sum(found) < 56
