"""One Shadow Dexterous Hand on two sliders (along the keyboard, and towards the keys' hinges)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.simulation.engine import mujoco
from sb3_piano.simulation.tables import load_table

FOREARM_JOINTS = ("forearm_tx", "forearm_ty")
"""The sliders that carry a hand: along the keyboard, and towards the keys' hinges, m."""

_SKIN_COLOR = (0.62, 0.64, 0.68, 1.0)
_FOREARM_MESH = "forearm"
# The radius of a fingertip's sphere, m; it has no use for the others, which are MuJoCo's defaults.
_SITE_SIZE = (0.004, 0.005, 0.005)
_FINGERS = ("th", "ff", "mf", "rf", "lf")

# Bits of contype and conaffinity. By default every shape of a hand meets every other, of either
# hand, and the keyboard, whose conaffinity is 1.
_KEYBOARD, _OTHER_HAND = 1, 2
# As wide as the hull and as long: forearms are always parallel, so that they meet where hulls do.
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
    reduced = _ActionSpace.reduced(table["reduced_action_space"])
    space = reduced if reduced_action_space else _ActionSpace()
    for entry in hand["bodies"]:
        parent = spec.body(entry["parent"]) if entry["parent"] else spec.worldbody
        body = parent.add_body(
            name=entry["name"],
            pos=entry["pos"],
            quat=entry["quat"],
            gravcomp=float(gravity_compensation),
            **_inertial(entry["inertial"]),
        )
        for joint in entry["joints"]:
            if space.has(joint["name"]):
                _add_joint(body, {**table["joint_defaults"], **joint}, space, coupled_friction_only)
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
        _add_actuator(spec, actuator, space)
    return spec


def fingertip_sites(side: str) -> list[str]:
    """Return the names of a hand's fingertip sites in the scene, thumb to little finger."""
    prefix = load_table("shadow_hands")[side]["prefix"]
    return [f"{prefix}_shadow_hand/{finger}distal_site" for finger in _FINGERS]


def fingertip_bodies(side: str) -> list[str]:
    """Return the names of a hand's last finger links in the scene, thumb to little finger."""
    prefix = load_table("shadow_hands")[side]["prefix"]
    return [f"{prefix}_shadow_hand/{prefix}_{finger}distal" for finger in _FINGERS]


def forearm_body(side: str) -> str:
    """Return the name of a hand's forearm body in the scene."""
    prefix = load_table("shadow_hands")[side]["prefix"]
    return f"{prefix}_shadow_hand/{prefix}_forearm"


@dataclass(frozen=True)
class _ActionSpace:
    """Joints that move, and their ranges; joints are known by the ends of their names."""

    removed: tuple[str, ...] = ()
    ranges: Mapping[str, list[float]] = field(default_factory=dict)

    @classmethod
    def reduced(cls, table: dict[str, Any]) -> _ActionSpace:
        return cls(tuple(table["joints_removed"]), {"THJ2": table["THJ2_range"]})

    def has(self, joint: str) -> bool:
        return not joint.endswith(self.removed)

    def range_of(self, joint: str, full_range: list[float]) -> list[float]:
        return self.ranges.get(joint.rpartition("_")[2], full_range)


def _playing_masks(side: str, body: str) -> dict[str, int]:
    """Return the collision masks of a link that need not meet its own hand.

    Two shapes meet where one's contype shares a bit with the other's conaffinity, so it is enough
    that the right hand can be met by the left one.
    """
    keyboard = _KEYBOARD if body.endswith(_PLAYING_LINKS) else 0
    if side == "right":
        return {"contype": keyboard, "conaffinity": _OTHER_HAND}
    return {"contype": keyboard | _OTHER_HAND, "conaffinity": 0}


def _inertial(table: dict[str, Any]) -> dict[str, Any]:
    return {
        "mass": table["mass"],
        "ipos": table["pos"],
        "iquat": table["quat"],
        "inertia": table["diaginertia"],
        "explicitinertial": True,
    }


def _add_joint(
    body: mujoco.MjsBody, table: dict[str, Any], space: _ActionSpace, coupled_friction_only: bool
) -> None:
    kind = getattr(mujoco.mjtJoint, f"mjJNT_{table['type'].upper()}")
    joint = body.add_joint(
        **{**table, "type": kind, "range": space.range_of(table["name"], table["range"])}
    )
    if coupled_friction_only and not joint.name.endswith(_COUPLED_JOINTS):
        joint.frictionloss = 0.0


def _add_geom(body: mujoco.MjsBody, table: dict[str, Any]) -> None:
    kind = getattr(mujoco.mjtGeom, f"mjGEOM_{table['type'].upper()}")
    geom = body.add_geom(**{**table, "type": kind, "rgba": _SKIN_COLOR})
    if table["type"] == "mesh":
        geom.meshname = _FOREARM_MESH


def _add_actuator(spec: mujoco.MjSpec, table: dict[str, Any], space: _ActionSpace) -> None:
    """Add a position servo on a joint, or on the sum of two joints (a fixed tendon)."""
    name, joints = table["name"], table["joints"]
    if not space.has(joints[0]):
        return
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
        ctrlrange=space.range_of(joints[0], table["ctrlrange"]),
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
