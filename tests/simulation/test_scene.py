"""The compiled scene: sizes, order and reading of its state."""

import itertools

import mujoco
import numpy as np
import pytest

from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.simulation import PHYSICS_PROFILES, compile_scene


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


# What the fast profiles leave out of the simulation, and what they keep.


def settled(scene, seconds=0.5):
    """Return the simulation after the keys had time to come to rest."""
    data = mujoco.MjData(scene.model)
    mujoco.mj_step(scene.model, data, nstep=round(seconds / scene.model.opt.timestep))
    return data


@pytest.mark.parametrize("gravity_compensation", [True, False])
def test_idle_keys_of_the_fast_profile_rest_at_zero_without_a_constraint(gravity_compensation):
    scene = compile_scene(physics="fast", gravity_compensation=gravity_compensation)
    data = settled(scene)
    np.testing.assert_allclose(data.qpos[scene.key_qpos], 0.0, atol=1e-9)
    limits = data.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
    key_joints = set(range(scene.model.njnt)) & set(scene.key_qpos.tolist())
    assert not set(data.efc_id[limits].tolist()) & key_joints
    reference = settled(compile_scene(gravity_compensation=gravity_compensation))
    limits = reference.efc_type == mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT
    assert len(set(reference.efc_id[limits].tolist()) & key_joints) == NUM_KEYS


def holding_torque(scene):
    """Return the torque that holds each key fully down, (88,) N m."""
    data = mujoco.MjData(scene.model)
    data.qpos[scene.key_qpos] = scene.key_max_angle
    mujoco.mj_forward(scene.model, data)
    return (data.qfrc_bias - data.qfrc_passive)[scene.key_qpos]


def index_beside_middle(physics):
    """Return the way from a middle finger to an index finger that is pressed on it, m."""
    scene = compile_scene(physics=physics)
    data = mujoco.MjData(scene.model)
    for name, end in (("FFJ4", 1), ("MFJ4", 0)):
        actuator = scene.model.actuator(f"rh_shadow_hand/rh_A_{name}").id
        data.ctrl[actuator] = scene.model.actuator_ctrlrange[actuator, end]
    mujoco.mj_step(scene.model, data, nstep=round(1 / scene.model.opt.timestep))
    index, middle = scene.fingertip_position(data)[1:3]
    return float(middle[1] - index[1])


def test_the_faithful_profile_has_the_steps_of_the_reference():
    steps = {name: profile.timestep for name, profile in PHYSICS_PROFILES.items()}
    assert steps["faithful"] == steps["reference"] == 0.005
    assert steps["fast"] == steps["fast-contacts"] == 0.01


def test_fingers_of_a_hand_get_into_each_other_s_way_unless_the_profile_is_fast():
    beside = {physics: index_beside_middle(physics) for physics in PHYSICS_PROFILES}
    assert beside["reference"] > 0.015 > -0.03 > beside["fast"], "it passes through"
    for physics in ("fast-contacts", "faithful"):
        assert beside[physics] == pytest.approx(beside["reference"], abs=1e-3)


@pytest.mark.parametrize("gravity_compensation", [True, False])
def test_holding_a_key_down_takes_the_same_torque_in_both_profiles(gravity_compensation):
    reference, fast = (
        compile_scene(physics=physics, gravity_compensation=gravity_compensation)
        for physics in ("reference", "fast")
    )
    np.testing.assert_allclose(holding_torque(fast), holding_torque(reference), rtol=5e-3)


def test_hands_without_gravity_hang_as_hands_whose_weight_is_balanced():
    assert not compile_scene(physics="fast").model.opt.gravity.any()
    assert compile_scene(physics="fast", gravity_compensation=False).model.opt.gravity.any()
    reference, fast = settled(compile_scene()), settled(compile_scene(physics="fast"))
    hands = np.concatenate(compile_scene().joint_qpos)
    np.testing.assert_allclose(fast.qpos[hands], reference.qpos[hands], atol=1e-6)


def released(physics):
    """Return a key's angles (rad) in the half second after it was let go of, and the limits met."""
    scene = compile_scene(physics=physics, sides=("right",))
    data = mujoco.MjData(scene.model)
    key = scene.key_qpos[5]  # which the right hand does not reach
    data.qpos[key] = scene.key_max_angle[5]
    angles = []
    while data.time < 0.5:
        mujoco.mj_step(scene.model, data)
        angles.append(data.qpos[key])
    return np.array(angles), data.nl


def test_a_released_key_is_stopped_at_rest_but_on_the_fast_profile_and_then_costs_nothing():
    reference, limits = released("reference")
    faithful, fewer = released("faithful")
    swinging, _ = released("fast")
    assert reference.min() > -0.008
    assert faithful.min() > -0.008
    assert swinging.min() < -0.012
    np.testing.assert_allclose(faithful, reference, atol=0.003)
    assert (limits >= 88, fewer) == (True, 0)


def may_meet(model, first, second):
    """Return whether MuJoCo looks for contacts of two geoms, by their masks."""
    return bool(
        model.geom_contype[first] & model.geom_conaffinity[second]
        or model.geom_contype[second] & model.geom_conaffinity[first]
    )


def owner_and_link(model, geom):
    body = model.body(model.geom_bodyid[geom]).name
    return body.partition("/")[0], body.rpartition("_")[2]


def test_the_fast_profile_looks_for_contacts_with_keys_and_between_the_hands_only():
    model = compile_scene(physics="fast").model
    colliding = np.flatnonzero(model.geom_contype | model.geom_conaffinity)
    met = set()
    for first, second in itertools.combinations(colliding, 2):
        (owner, link), (other, other_link) = (
            owner_and_link(model, geom) for geom in (first, second)
        )
        if {owner, other} == {"rh_shadow_hand", "lh_shadow_hand"}:
            assert may_meet(model, first, second), (link, other_link)
            met.add("hands")
        elif owner == other:
            assert not may_meet(model, first, second), (owner, link, other_link)
        else:
            hand_link = other_link if owner == "piano" else link
            plays = hand_link.endswith(("distal", "middle"))
            assert may_meet(model, first, second) == plays, (link, other_link)
            met.add("keys")
    assert met == {"hands", "keys"}
