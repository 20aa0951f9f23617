"""One Shadow Dexterous Hand on its forearm, which slides along the keyboard, and more if wanted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, get_args

from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import refuse_unknown
from sb3_piano.simulation.engine import mujoco
from sb3_piano.simulation.tables import load_table

ForearmDof = Literal[
    "forearm_tx", "forearm_ty", "forearm_tz", "forearm_roll", "forearm_pitch", "forearm_yaw"
]
"""A joint of a forearm and its actuator, named as in RoboPianist. It slides along the keyboard,
towards the keys' hinges and up, m; and turns about its own axis, up and to the side, rad."""

FOREARM_DOFS: tuple[ForearmDof, ...] = get_args(ForearmDof)
"""All of them, in their order."""

DEFAULT_FOREARM_DOFS: tuple[ForearmDof, ...] = ("forearm_tx", "forearm_ty")
"""Those that RoboPianist's authors train with."""

ALONG: ForearmDof = "forearm_tx"
"""The slider along the keyboard, which every hand has."""

FINGERTIPS = tuple(f"{finger}distal" for finger in ("th", "ff", "mf", "rf", "lf"))
"""Links that press keys, thumb to little finger."""

_SKIN_COLOR = (0.62, 0.64, 0.68, 1.0)
_FOREARM_MESH = "forearm"
# The radius of a fingertip's sphere, m; it has no use for the others, which are MuJoCo's defaults.
_SITE_SIZE = (0.004, 0.005, 0.005)

# Bits of contype and conaffinity. By default every shape of a hand meets every other, of either
# hand, and the keyboard, whose conaffinity is 1.
_KEYBOARD, _OTHER_HAND = 1, 2
# As wide as the hull and as long: forearms that do not turn are parallel, and meet where hulls do.
_CAPSULE = {"type": "capsule", "size": [0.0748, 0.0167, 0.0], "pos": [0.0, 0.0, 0.0914]}
_ALL_CONTACTS = {"contype": _KEYBOARD, "conaffinity": _KEYBOARD}
_PLAYING_LINKS = ("distal", "middle")

# The fingers' joints that share their actuator with the joint after them (not THJ2).
_COUPLED_JOINTS = ("FFJ2", "MFJ2", "RFJ2", "LFJ2")


def build_hand(
    side: str,
    *,
    reduced_action_space: bool,
    gravity_compensation: bool,
    forearm_dofs: Sequence[str] = DEFAULT_FOREARM_DOFS,
    coupled_friction_only: bool = False,
    playing_contacts_only: bool = False,
    capsule_forearm: bool = False,
) -> mujoco.MjSpec:
    """Return the specification of a hand, to be attached to a scene.

    Its own collision shapes are what is seen; there are no mesh files.

    Args:
        side: ``"right"`` or ``"left"``.
        reduced_action_space: Fix the joints LFJ5, THJ5 and THJ1 and halve the range of THJ2, as
            RoboPianist's reduced action space does.
        gravity_compensation: Let a force balance the weight of every body of the hand.
        forearm_dofs: Joints of the forearm, in the order of ``FOREARM_DOFS``.
        coupled_friction_only: Let only the middle joints of the fingers have dry friction, see
            :class:`~sb3_piano.simulation.physics.PhysicsProfile`.
        playing_contacts_only: Meet only the other hand, and the keyboard with fingertips and
            middle phalanges.
        capsule_forearm: Let a capsule stand for the forearm's hull.
    """
    table = load_table("shadow_hands")
    hand = table[side]
    spec = mujoco.MjSpec()
    spec.modelname = f"{hand['prefix']}_shadow_hand"
    spec.compiler.degree = False
    spec.add_mesh(name=_FOREARM_MESH, uservert=_hull_vertices(table["forearm_hull_rings"]))
    reduced = table["reduced_action_space"]
    removed = tuple(name for name in FOREARM_DOFS if name not in forearm_dofs)
    ranges: dict[str, list[float]] = {}
    if reduced_action_space:
        removed += tuple(reduced["joints_removed"])
        ranges[f"{hand['prefix']}_THJ2"] = reduced["THJ2_range"]
    for entry in hand["bodies"]:
        parent = spec.body(entry["parent"]) if entry["parent"] else spec.worldbody
        body = parent.add_body(
            name=entry["name"],
            pos=entry["pos"],
            quat=entry["quat"],
            gravcomp=float(gravity_compensation),
            mass=entry["inertial"]["mass"],
            ipos=entry["inertial"]["pos"],
            iquat=entry["inertial"]["quat"],
            inertia=entry["inertial"]["diaginertia"],
            explicitinertial=True,
        )
        for joint in entry["joints"]:
            if not joint["name"].endswith(removed):
                limits = {"range": ranges.get(joint["name"], joint["range"])}
                numbers = {**table["joint_defaults"], **joint, **limits}
                _add_joint(body, numbers, coupled_friction_only)
        masks = _playing_masks(side, body.name) if playing_contacts_only else _ALL_CONTACTS
        for geom in entry["geoms"]:
            shape = geom if geom["type"] != "mesh" or not capsule_forearm else _CAPSULE
            _add_geom(body, {**table["geom_defaults"], **masks, **shape})
        if "fingertip" in entry:
            finger = body.name.split("_")[1]
            body.add_site(name=f"{finger}_site", pos=entry["fingertip"], size=_SITE_SIZE, group=4)
    for first, second in hand["contact_excludes"]:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    for actuator in hand["actuators"]:
        if not actuator["joints"][0].endswith(removed):
            _add_actuator(spec, actuator, ranges)
    return spec


def check_forearm_dofs(dofs: Sequence[str]) -> None:
    """Make sure that joints are those of a forearm that can play.

    Raises:
        ConfigError: If one is unknown, twice there or not in its place, or the slider along the
            keyboard is missing.
    """
    refuse_unknown(dofs, FOREARM_DOFS, "joint", "forearm_dofs")
    expected = [name for name in FOREARM_DOFS if name in {*dofs, ALONG}]
    if list(dofs) != expected:
        raise ConfigError(
            f"forearm_dofs is {list(dofs)}: expected {expected}, each joint once, in RoboPianist's "
            f"order, and {ALONG!r}, without which a hand stays where it is."
        )


def body_name(side: str, link: str) -> str:
    """Return the name of a link of a hand in the scene, such as ``"forearm"``."""
    prefix = load_table("shadow_hands")[side]["prefix"]
    return part_name(side, f"{prefix}_{link}")


def part_name(side: str, name: str) -> str:
    """Return the name in the scene of what has a name in a hand."""
    return f"{load_table('shadow_hands')[side]['prefix']}_shadow_hand/{name}"


def _playing_masks(side: str, body: str) -> dict[str, int]:
    """Return the collision masks of a link that need not meet its own hand.

    Two shapes meet where one's contype shares a bit with the other's conaffinity, so it is enough
    that the right hand can be met by the left one.
    """
    keyboard = _KEYBOARD if body.endswith(_PLAYING_LINKS) else 0
    if side == "right":
        return {"contype": keyboard, "conaffinity": _OTHER_HAND}
    return {"contype": keyboard | _OTHER_HAND, "conaffinity": 0}


def _add_joint(body: mujoco.MjsBody, table: dict[str, Any], coupled_friction_only: bool) -> None:
    kind = getattr(mujoco.mjtJoint, f"mjJNT_{table['type'].upper()}")
    joint = body.add_joint(**{**table, "type": kind})
    if coupled_friction_only and not joint.name.endswith(_COUPLED_JOINTS):
        joint.frictionloss = 0.0


def _add_geom(body: mujoco.MjsBody, table: dict[str, Any]) -> None:
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{table['type'].upper()}")
    geom = body.add_geom(**{**table, "type": kind, "rgba": _SKIN_COLOR})
    if table["type"] == "mesh":
        geom.meshname = _FOREARM_MESH


def _add_actuator(
    spec: mujoco.MjSpec, table: dict[str, Any], ranges: dict[str, list[float]]
) -> None:
    """Add a position servo on a joint, or on the sum of two joints (a fixed tendon)."""
    name, joints = table["name"], table["joints"]
    target, kind = joints[0], mujoco.mjtTrn.mjTRN_JOINT
    if len(joints) > 1:
        target, kind = name.replace("_A_", "_T_"), mujoco.mjtTrn.mjTRN_TENDON
        tendon = spec.add_tendon(name=target)
        for joint in joints:
            tendon.wrap_joint(joint, 1.0)
    servo = spec.add_actuator(
        name=name,
        target=target,
        trntype=kind,
        ctrlrange=ranges.get(joints[0], table["ctrlrange"]),
    )
    servo.set_to_position(kp=table["kp"])
    if "forcerange" in table:
        servo.forcerange = table["forcerange"]


def _hull_vertices(rings: list[dict[str, float]]) -> list[float]:
    """Return the forearm's collider: regular rings of points around z, from -180 degrees on."""
    vertices: list[float] = []
    for ring in rings:
        count = int(ring["points"])
        for i in range(count):
            angle = -math.pi + 2 * math.pi * i / count
            radius = ring["radius"]
            vertices += [radius * math.cos(angle), radius * math.sin(angle), ring["z"]]
    return vertices
