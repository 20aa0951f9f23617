"""Assembly and compilation of the scene from its parts."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.engine import mujoco
from sb3_piano.hands import DEFAULT_HAND, HandSpec, find_hand
from sb3_piano.hands.model import build_hand
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.music.hands import Hand
from sb3_piano.settings import Whole, checked
from sb3_piano.simulation import keyboard
from sb3_piano.simulation.physics import physics_profile
from sb3_piano.simulation.scene import SIDES, PianoScene

# Offset of the press point from the centre of a key, as in RoboPianist: shares of the half length
# (away from the hinge) and of the half height (up).
_PRESS_POINT_X = 0.35
_PRESS_POINT_Z = 0.5

# Safety margin of the distance beyond which forearms cannot touch, m.
_CLEARANCE = 0.005


@functools.lru_cache(maxsize=8)
def compile_scene(
    *,
    reduced_action_space: bool = True,
    gravity_compensation: bool = True,
    physics: str = "reference",
    moving_keys: tuple[int, int] = keyboard.ALL_KEYS_MOVE,
    sides: tuple[Hand, ...] = SIDES,
    hand: str = DEFAULT_HAND,
    forearm_dofs: tuple[str, ...] | None = None,
) -> PianoScene:
    """Build and compile the scene; equal arguments return the same object (``copy`` it to change).

    Args:
        reduced_action_space: Leave out the joints that RoboPianist leaves out, too.
        gravity_compensation: Balance the weight of the hands by forces.
        physics: Name of a physics profile.
        moving_keys: Lowest and highest moving key. The others are rigid: hands can rest on them,
            but they never go down. Fewer moving keys make physics steps faster.
        sides: Hands in the scene, the right one first. Without hands each key has an
            actuator.
        hand: Name of a hand, or the path of its folder.
        forearm_dofs: Joints of each forearm; by default its sliders along and across the keyboard.

    Raises:
        ConfigError: If the physics profile or the hand is unknown, or keys or joints do not exist.
    """
    options: dict[str, Any] = dict(locals())  # the arguments
    found = find_hand(hand)
    options |= {"hand": found.source, "forearm_dofs": found.forearm_dofs(forearm_dofs)}
    return assemble_scene(scene_parts(**options), options)


def assemble_scene(parts: Sequence[mujoco.MjSpec], options: Mapping[str, Any]) -> PianoScene:
    """Attach parts to the first of them, the world, compile it, and index its elements.

    Args:
        parts: Parts from :func:`scene_parts`, possibly with added geoms.
        options: Arguments of :func:`scene_parts`.
    """
    prefixes = [f"{part.modelname}/" for part in parts[2:]]  # of the names of each hand
    return _index_scene(attach_parts(parts).compile(), prefixes, options)


def attach_parts(parts: Sequence[mujoco.MjSpec]) -> mujoco.MjSpec:
    """Attach parts from :func:`scene_parts` to the first of them, and return it."""
    world, *attached = parts
    _number_unnamed(world, "/")
    for part in attached:
        prefix = f"{part.modelname}/"
        _number_unnamed(part)
        frame = world.worldbody.add_body(name=prefix).add_frame()
        world.attach(part, prefix=prefix, frame=frame)
    return world


def scene_parts(
    *,
    reduced_action_space: bool = True,
    gravity_compensation: bool = True,
    physics: str = "reference",
    moving_keys: tuple[int, int] = keyboard.ALL_KEYS_MOVE,
    sides: tuple[Hand, ...] = SIDES,
    hand: str = DEFAULT_HAND,
    forearm_dofs: tuple[str, ...] | None = None,
) -> list[mujoco.MjSpec]:
    """Make the specifications of the scene: the world, then the keyboard, then the hands.

    Args and errors are as for :func:`compile_scene`, which attaches each part to its own body of
    the world and prefixes all names with the part's name and a slash.
    """
    first, last = moving_keys
    checked("first moving key", first, Annotated[Whole, Ge(0), Le(NUM_KEYS - 1)])
    checked("last moving key", last, Annotated[Whole, Ge(first), Le(NUM_KEYS - 1)])
    profile, robot = physics_profile(physics), find_hand(hand)
    world = mujoco.MjSpec()
    world.modelname = "scene"
    world.option.timestep, world.option.integrator = profile.timestep, profile.integrator
    world.option.impratio = 10  # as RoboPianist's
    # If all weights are balanced, leaving out gravity changes nothing and is cheaper.
    weightless = gravity_compensation and profile.balanced_keys
    if weightless:
        world.option.gravity = [0, 0, 0]
        world.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    _furnish(world)
    piano = keyboard.build_keyboard(
        profile, gravity=not weightless, moving_keys=moving_keys, driven=not sides
    )
    hands = [
        build_hand(
            robot,
            side,
            profile,
            reduced_action_space=reduced_action_space,
            gravity_compensation=gravity_compensation and not weightless,
            forearm_dofs=robot.forearm_dofs(forearm_dofs),
        )
        for side in sides
    ]
    return [world, piano, *hands]


def _number_unnamed(spec: mujoco.MjSpec, prefix: str = "") -> None:
    """Name unnamed elements as dm_control does: names are a part of the compiled model."""
    unnamed = {"geom": spec.geoms, "light": spec.lights, "contact": spec.excludes}
    for kind, elements in unnamed.items():
        for number, element in enumerate(e for e in elements if not e.name):
            element.name = f"{prefix}/unnamed_{kind}_{number}"


def _furnish(spec: mujoco.MjSpec) -> None:
    """Add floor, lights and cameras, which do not affect the physics."""
    visual = spec.visual
    visual.global_.offwidth, visual.global_.offheight = 1920, 1080
    # A quarter of MuJoCo's default; pictures look alike, and take half as long without a GPU.
    visual.quality.shadowsize = 1024
    light = visual.headlight
    light.ambient, light.diffuse, light.specular = [0.35] * 3, [0.4] * 3, [0.1] * 3
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=256,
        height=256,
        rgb1=[0.86, 0.89, 0.93],
        rgb2=[0.55, 0.6, 0.68],
    )
    world = spec.worldbody
    world.add_light(pos=[-0.4, -0.6, 1.6], dir=[0.25, 0.35, -1], diffuse=[0.5] * 3)
    world.add_light(pos=[0.6, 0.7, 1.6], dir=[-0.3, -0.4, -1], diffuse=[0.3] * 3, castshadow=False)
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[1, 1, 0.05],
        rgba=[0.42, 0.4, 0.38, 1],
        contype=0,
        conaffinity=0,
    )
    # From behind the keyboard, with a view of fingertips and keys; then from above.
    world.add_camera(
        name="overview", pos=[-0.5, 0, 0.56], xyaxes=[0, -1, 0, 0.56, 0, 0.83], fovy=52
    )
    world.add_camera(name="topdown", pos=[0.05, 0, 1.15], xyaxes=[0, 1, 0, -1, 0, 0], fovy=40)


def _index_scene(
    model: mujoco.MjModel, prefixes: Sequence[str], options: Mapping[str, Any]
) -> PianoScene:
    """Look up all names once; ``prefixes`` begin the names of each hand."""
    (first, last), sides = options["moving_keys"], options["sides"]
    moving, table = slice(first, last + 1), keyboard.table()
    colors = list(enumerate(key["color"] for key in table["keys"]))
    max_angle = np.array([table[color]["max_angle"] for _, color in colors])
    key_joint = np.array([model.joint(f"piano/{c}_joint_{key}").id for key, c in colors[moving]])
    key_geom = np.array([model.geom(f"piano/{color}_key_{key}").id for key, color in colors])
    addresses = model.jnt_qposadr[key_joint].astype(np.intp)
    assert (np.diff(addresses) == 1).all(), "keys are joints in a row"
    press_offset = np.zeros((NUM_KEYS, 3))
    press_offset[:, 0] = _PRESS_POINT_X * model.geom_size[key_geom, 0]
    press_offset[:, 2] = _PRESS_POINT_Z * model.geom_size[key_geom, 2]
    hand = find_hand(options["hand"])
    bodies = [_of_hand(model, "body", prefix, hand) for prefix in prefixes]
    tips = [body[link] for body in bodies for link in hand.tips]
    forearm_geoms = tuple(
        np.flatnonzero(model.geom_bodyid == body[hand.forearm.body]).tolist() for body in bodies
    )
    of_hands = [_of_hand(model, "joint", prefix, hand) for prefix in prefixes]
    hand_joints = tuple(_forearm_last(joints, hand) for joints in of_hands)
    sliders = [joints[hand.forearm.joints["along"]] for joints in of_hands]
    pressed = mujoco.MjData(model)
    pressed.qpos[addresses] = max_angle[moving]
    mujoco.mj_kinematics(model, pressed)
    axes = pressed.geom_xmat[key_geom].reshape(-1, 3, 3)
    return PianoScene(
        model=model,
        sides=sides,
        moving_keys=moving,
        key_qpos=addresses,
        key_min_angle=np.zeros(len(key_joint)),
        key_max_angle=max_angle,
        key_sounding_angle=max_angle - table["sounding_margin"],
        key_slice=slice(int(addresses[0]), int(addresses[-1]) + 1),
        key_geom=key_geom,
        key_boxes=(pressed.geom_xpos[key_geom], axes, model.geom_size[key_geom]),
        key_press_offset=press_offset,
        fingertip_site=np.array([np.flatnonzero(model.site_bodyid == b)[0] for b in tips], np.intp),
        fingertip_geom=model.body_geomadr[tips].astype(np.intp),
        joints=hand_joints,
        actuator_of_joint=_actuator_of_joint(model, hand_joints),
        forearm_geoms=forearm_geoms,
        forearm_reach=_forearm_reach(model, forearm_geoms) if len(sides) > 1 else 0.0,
        slider_qpos=model.jnt_qposadr[sliders].astype(np.intp),
        hand=hand,
        options=options,
    )


def _of_hand(model: mujoco.MjModel, kind: str, prefix: str, hand: HandSpec) -> dict[str, int]:
    """Find the bodies or the joints of a hand by short name, in the model's order."""
    count = model.nbody if kind == "body" else model.njnt
    names = (getattr(model, kind)(index).name for index in range(count))
    return {hand.short(n): index for index, n in enumerate(names) if n.startswith(prefix)}


def _forearm_last(joints: Mapping[str, int], hand: HandSpec) -> IntArray:
    """Return a hand's joints in the order of RoboPianist's observation."""
    forearm = [name for name in hand.forearm.joints.values() if name in joints]
    others = [joint for name, joint in joints.items() if name not in forearm]
    return np.array([*others, *(joints[name] for name in forearm)])


def _actuator_of_joint(model: mujoco.MjModel, hands: tuple[IntArray, ...]) -> FloatArray:
    """Compute the actuators' Jacobian, constant as all drive joints or fixed tendons."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    moment = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(
        moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    return moment[:, [model.jnt_dofadr[joint] for joints in hands for joint in joints]]


def _forearm_reach(model: mujoco.MjModel, geoms: Sequence[list[int]]) -> float:
    """Compute the largest distance of touching forearms' first geoms along the keyboard, m.

    The extent of forearms that only slide is constant; the geoms of forearms that turn stay within
    spheres around the first one.
    """
    bodies = [model.geom_bodyid[shapes[0]] for shapes in geoms]
    if (model.jnt_type[np.isin(model.jnt_bodyid, bodies)] != mujoco.mjtJoint.mjJNT_SLIDE).any():
        away = [np.linalg.norm(model.geom_pos[s] - model.geom_pos[s[0]], axis=1) for s in geoms]
        beyond = model.geom_rbound + model.geom_margin
        return sum(
            float((far + beyond[s]).max()) + _CLEARANCE for far, s in zip(away, geoms, strict=True)
        )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    row = data.geom_xmat[:, 3:6]  # world y in the frame of each geom
    middle = data.geom_xpos[:, 1] + (row * model.geom_aabb[:, :3]).sum(axis=1)
    half = (np.abs(row) * model.geom_aabb[:, 3:]).sum(axis=1) + model.geom_margin + _CLEARANCE
    low = [(middle - half)[shapes].min() - data.geom_xpos[shapes[0], 1] for shapes in geoms]
    high = [(middle + half)[shapes].max() - data.geom_xpos[shapes[0], 1] for shapes in geoms]
    return float(max(high[0] - low[1], high[1] - low[0]))
