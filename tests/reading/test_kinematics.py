"""Where the fingertips are: against MuJoCo itself, one posture at a time."""

import mujoco
import numpy as np
import pytest
from hand_parts import arm_of, data_at, hand_of, joints_by_name, random_positions, scene_of

from sb3_piano.hands import find_hand
from sb3_piano.planning.bends import EvenBends

FOREARM_DOFS = tuple(find_hand().forearm.joints.values())

BOTH_HANDS = pytest.mark.parametrize("hand", [0, 1])
SCENES = pytest.mark.parametrize(
    "options",
    [
        {"full": True},
        {"full": False},
        {"full": True, "physics": "fast"},
        {"full": False, "gravity_compensation": False, "moving_keys": (30, 40)},
        {"full": False, "forearm_dofs": FOREARM_DOFS},
        {"full": False, "forearm_dofs": ("forearm_tx", "forearm_yaw")},
    ],
    ids=lambda options: "-".join(map(str, options.values())),
)


def fingertips_by_hand(scene, data, hand):
    """Return the centres of the round ends that are farther from the last joints, (5, 3) m."""
    tips = []
    for geom in scene.fingertip_geom[5 * hand : 5 * hand + 5]:
        assert scene.model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
        along = data.geom_xmat[geom].reshape(3, 3)[:, 2] * scene.model.geom_size[geom, 1]
        joint = data.xpos[scene.model.geom_bodyid[geom]]
        ends = [data.geom_xpos[geom] + along, data.geom_xpos[geom] - along]
        tips.append(max(ends, key=lambda end: np.linalg.norm(end - joint)))
    return np.array(tips)


def data_of(scene, hand, positions):
    """Return MuJoCo's data with one hand where it is and the other one at 0."""
    return data_at(scene, *((positions,) if hand == 0 else (np.zeros_like(positions), positions)))


@pytest.mark.slow
@SCENES
@BOTH_HANDS
def test_fingertips_and_forearm_are_where_mujoco_has_them_and_move_as_its_jacobians_say(
    options, hand
):
    scene = scene_of(**options)
    kinematics = hand_of(scene, hand)
    positions = random_positions(kinematics, 8)
    tips, jacobian = kinematics.fingertips_and_jacobian(positions)
    np.testing.assert_array_equal(tips, kinematics.fingertips(positions))
    by_actuator = joints_by_name(scene, hand)
    bodies = scene.model.geom_bodyid[scene.fingertip_geom[5 * hand : 5 * hand + 5]]
    forearm = scene.model.geom_bodyid[scene.forearm_geoms[hand][0]]
    for s, place in enumerate(arm_of(scene, hand).place(positions)):
        data = data_of(scene, hand, positions[s])
        if "forearm_yaw" not in scene.options["forearm_dofs"]:
            assert place == pytest.approx(data.xpos[forearm, 1], abs=1e-12)
        np.testing.assert_allclose(tips[s], fingertips_by_hand(scene, data, hand), atol=1e-12)
        for finger, body in enumerate(bodies):
            by_dof = np.zeros((3, scene.model.nv))
            mujoco.mj_jac(scene.model, data, by_dof, None, tips[s, finger], body)
            np.testing.assert_allclose(jacobian[s, finger], by_dof @ by_actuator, atol=1e-12)


@SCENES
def test_actuators_are_where_the_joints_put_them(options):
    scene = scene_of(**options)
    right, left = (random_positions(hand_of(scene, hand), 1, seed=2)[0] for hand in (0, 1))
    data = data_at(scene, right, left)
    np.testing.assert_allclose(data.actuator_length[hand_of(scene, 0).actuators], right, atol=1e-12)
    np.testing.assert_allclose(data.actuator_length[hand_of(scene, 1).actuators], left, atol=1e-12)
    for hand, positions in enumerate((right, left)):
        kinematics = hand_of(scene, hand)
        joints = data.qpos[scene.model.jnt_qposadr[kinematics.joint_ids]]
        np.testing.assert_allclose(kinematics.joint_of_actuator @ positions, joints, atol=1e-12)


@SCENES
@BOTH_HANDS
def test_evenly_bent_fingers_reach_where_uneven_ones_are(options, hand):
    scene = scene_of(**options)
    kinematics = hand_of(scene, hand)
    rng = np.random.default_rng(3)
    low, high = scene.joint_range[hand].T
    # Fingers that are bent by more than a little: straight ones cannot reach farther.
    joints = low + (high - low) * rng.uniform(0.2, 0.9, (6, len(low)))
    evenly = EvenBends(kinematics)
    even = evenly(joints)
    tips = kinematics.fingertips(even)
    addresses = scene.model.jnt_qposadr[kinematics.joint_ids]
    far_off = 0
    for s in range(len(joints)):
        data = data_at(scene, np.zeros(kinematics.size), np.zeros(kinematics.size))
        data.qpos[addresses] = joints[s]
        mujoco.mj_forward(scene.model, data)
        expected = fingertips_by_hand(scene, data, hand)
        np.testing.assert_allclose(tips[s], expected, atol=2e-4)
        plain = scene.actuator_positions(data.qpos[scene.hand_qpos])[kinematics.actuators]
        far_off += int((np.abs(kinematics.fingertips(plain[None])[0] - expected) > 2e-3).sum())
        np.testing.assert_array_equal(even[s], evenly(joints[s]))
    assert far_off > 10
