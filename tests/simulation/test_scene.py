"""The compiled scene: sizes, order and reading of its state."""

import mujoco
import numpy as np
import pytest

from sb3_piano.simulation import compile_scene


def test_the_model_needs_no_mesh_file_and_has_one_mesh_a_forearm():
    model = compile_scene().model
    assert model.nmesh == 2
    assert model.ngeom == 88 + 2 + 76  # keys; base and floor; shapes of both hands


def test_the_reduced_action_space_lacks_three_joints_a_hand_and_limits_the_thumb():
    full = compile_scene(reduced_action_space=False)
    reduced = compile_scene(reduced_action_space=True)
    missing = set(full.joint_names[0]) - set(reduced.joint_names[0])
    assert missing == {f"rh_shadow_hand/rh_{joint}" for joint in ("LFJ5", "THJ5", "THJ1")}
    thumb = reduced.model.joint("lh_shadow_hand/lh_THJ2")
    assert thumb.range.tolist() == [0.0, 0.698132]
    servo = reduced.model.actuator("lh_shadow_hand/lh_A_THJ2")
    assert servo.ctrlrange.tolist() == [0.0, 0.698132]


def test_fingertips_are_ordered_thumb_to_little_right_hand_first():
    scene = compile_scene()
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    y = scene.fingertip_position(data)[:, 1]
    # At rest the palms face down: the right thumb is the right hand's leftmost finger.
    assert np.all(np.diff(y[:5]) > 0)
    assert np.all(np.diff(y[5:]) < 0)
    assert y[:5].min() > 0 > y[5:].max()


def test_key_angles_outside_their_soft_limits_are_clipped():
    scene = compile_scene()
    data = mujoco.MjData(scene.model)
    data.qpos[scene.key_qpos[:2]] = [-0.01, 1.0]
    assert scene.key_angle(data)[:2].tolist() == [0.0, scene.key_max_angle[1]]


@pytest.mark.parametrize(("shortfall", "sounds"), [(0.00872, True), (0.00873, False)])
def test_a_key_sounds_within_half_a_degree_of_its_lowest_position(shortfall, sounds):
    scene = compile_scene()
    angle = scene.key_max_angle - shortfall
    assert np.all((angle >= scene.key_sounding_angle) == sounds)


def test_equal_arguments_share_one_compiled_scene_and_a_copy_has_its_own():
    scene = compile_scene()
    assert compile_scene() is scene
    copied = scene.copy()
    copied.model.opt.timestep = 0.001
    assert scene.model.opt.timestep == 0.005


def test_the_boxes_of_pressed_keys_lie_where_pressed_keys_are():
    """A key turns about its hinge by its largest angle: its far end goes down, its length stays."""
    scene = compile_scene()
    center, rotation, half_size = scene.key_boxes
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    at_rest = data.geom_xpos[scene.key_geom].copy()
    assert (center[:, 2] < at_rest[:, 2] - 0.002).all()
    data.qpos[scene.key_qpos] = scene.key_max_angle
    mujoco.mj_forward(scene.model, data)
    np.testing.assert_allclose(center, data.geom_xpos[scene.key_geom], atol=1e-12)
    np.testing.assert_allclose(half_size, scene.model.geom_size[scene.key_geom])
    np.testing.assert_allclose(np.arccos(rotation[:, 0, 0]), scene.key_max_angle, rtol=1e-6)
    # The hinge stays: seen from it, the centre is at the same distance as before.
    hinge = data.xanchor[scene.model.body_jntadr[scene.model.geom_bodyid[scene.key_geom]]]
    np.testing.assert_allclose(
        np.linalg.norm(center - hinge, axis=1), np.linalg.norm(at_rest - hinge, axis=1), rtol=1e-9
    )


def test_fingers_press_keys_where_robopianists_do_before_the_middle_and_over_the_top():
    scene = compile_scene()
    data = mujoco.MjData(scene.model)
    mujoco.mj_kinematics(scene.model, data)
    half = scene.model.geom_size[scene.key_geom]
    offset = scene.press_point(data, np.arange(88)) - data.geom_xpos[scene.key_geom]
    np.testing.assert_allclose(offset, half * [0.35, 0.0, 0.5], atol=1e-12)


@pytest.mark.parametrize("reduced", [True, False])
def test_actuators_are_where_the_joints_that_they_drive_are(reduced):
    scene = compile_scene(reduced_action_space=reduced)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = np.random.default_rng(0).uniform(-1, 1, scene.model.nq)
    mujoco.mj_forward(scene.model, data)
    joints = data.qpos[np.concatenate(scene.joint_qpos)]
    np.testing.assert_allclose(scene.actuator_of_joint @ joints, data.actuator_length, atol=1e-12)
    # One actuator bends two joints of a finger: it has moved by the sum of both.
    names = [name for names in scene.joint_names for name in names]
    for finger in ("rh_shadow_hand/rh_FF", "lh_shadow_hand/lh_LF"):
        hand = finger.split("/")[1][:2]
        row = scene.model.actuator(f"{hand}_shadow_hand/{hand}_A_{finger[-2:]}J0").id
        driven = [names[j] for j in np.flatnonzero(scene.actuator_of_joint[row])]
        assert sorted(driven) == [f"{finger}J1", f"{finger}J2"]
