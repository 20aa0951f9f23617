"""What the tests of the planning core share: scenes, hands, keys, and presses to choose from."""

import functools

import mujoco
import numpy as np

from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.planning import PlanSettings
from sb3_piano.planning.arm import Arm
from sb3_piano.planning.hand import Hand, resting_posture
from sb3_piano.reading import KeyPlaces
from sb3_piano.simulation import compile_scene
from sb3_piano.simulation.scene import SIDES

SETTINGS = PlanSettings()


@functools.cache
def scene_of(*, full=True, **options):
    """Return a scene, by default with the full action space."""
    return compile_scene(reduced_action_space=not full, **options)


@functools.cache
def keys_of(scene):
    return KeyPlaces.of(scene)


@functools.cache
def hand_of(scene, hand):
    return HandKinematics(scene, hand)


@functools.cache
def arm_of(scene, hand):
    return Arm(scene, hand_of(scene, hand))


def rest_of(scene, hand):
    """Return where a hand's actuators rest; physics has no say in it, so that few are enough."""
    return _rest(scene.model.nu == scene_of().model.nu, hand)


@functools.cache
def _rest(full, hand):
    scene = scene_of(full=full)
    return resting_posture(hand_of(scene, hand), keys_of(scene))


@functools.cache
def whole_hand(scene, hand):
    return Hand.of(scene, hand, keys_of(scene), n_substeps=10)


def random_positions(kinematics, count, seed=0):
    """Return positions all over the control ranges, (count, n)."""
    random = np.random.default_rng(seed)
    return random.uniform(kinematics.low, kinematics.high, (count, kinematics.size))


def joints_by_name(scene, hand):
    """Return how a hand's joints move with its actuators, found by their names.

    Returns:
        (nv, n): by how much each degree of freedom of the model moves with each actuator. J0 is
        the sum of J1 and J2, which here bend alike.
    """
    model = scene.model
    prefix = f"{SIDES[hand][0]}h_shadow_hand/"
    half = model.nu // 2
    result = np.zeros((model.nv, half))
    for column in range(half):
        name = model.actuator(hand * half + column).name
        assert name.startswith(prefix)
        joint = name.replace("_A_", "_")
        if joint.endswith("J0"):
            for end in ("J1", "J2"):
                result[model.joint(joint[:-2] + end).dofadr[0], column] = 0.5
        else:
            result[model.joint(joint).dofadr[0], column] = 1.0
    return result


def data_at(scene, *positions):
    """Return MuJoCo's data with the joints of the right (and the left) hand where they are."""
    data = mujoco.MjData(scene.model)
    for hand, one in enumerate(positions):
        data.qpos += joints_by_name(scene, hand) @ one  # hinges and sliders only: nq is nv
    mujoco.mj_forward(scene.model, data)
    return data


@functools.cache
def turned_boxes(scene, share):
    """Return all keys' boxes at a share of their travel, found by turning them in MuJoCo.

    Returns:
        (88, 3) centres, (88, 3, 3) axes as columns, (88, 3) half lengths.
    """
    data = mujoco.MjData(scene.model)
    data.qpos[scene.key_qpos] = (share * scene.key_max_angle)[scene.moving_keys]
    mujoco.mj_kinematics(scene.model, data)
    return (
        data.geom_xpos[scene.key_geom],
        data.geom_xmat[scene.key_geom].reshape(-1, 3, 3),
        scene.model.geom_size[scene.key_geom],
    )


def over_the_top(scene, point, key, share):
    """Return how far a point lies over the top of a key at a share of its travel, straight up."""
    centre, axes, half = (part[key] for part in turned_boxes(scene, share))
    top, normal = centre + axes[:, 2] * half[2], axes[:, 2]
    return float((point - top) @ normal / normal[2])


def sounding_share(scene, key):
    """Return from which share of its travel on a key sounds."""
    return float(scene.key_sounding_angle[key] / scene.key_max_angle[key])
