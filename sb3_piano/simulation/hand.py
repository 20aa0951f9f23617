"""One Shadow Dexterous Hand on two sliders (along the keyboard, and towards the keys' hinges)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.simulation.dm_mjcf import mjcf
from sb3_piano.simulation.tables import load_table

FOREARM_JOINTS = ("forearm_tx", "forearm_ty")
"""The sliders that carry a hand: along the keyboard, and towards the keys' hinges, m."""

_SKIN_COLOR = (0.62, 0.64, 0.68, 1.0)
_FINGERS = ("th", "ff", "mf", "rf", "lf")

# Bits of contype and conaffinity. By default every shape of a hand meets every other, of either
# hand, and the keyboard, whose conaffinity is 1.
_KEYBOARD, _OTHER_HAND = 1, 2
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
) -> mjcf.RootElement:
    """Return the MJCF of a hand, to be attached to a scene.

    Its own collision shapes are what is seen; there are no mesh files.

    Args:
        side: ``"right"`` or ``"left"``.
        reduced_action_space: Fix the joints LFJ5, THJ5 and THJ1 and halve the range of THJ2, as
            RoboPianist's reduced action space does.
        gravity_compensation: Let a force balance the weight of every body of the hand.
        coupled_friction_only: Let only the middle joints of the fingers have dry friction, see
            :class:`~sb3_piano.simulation.PhysicsProfile`.
        playing_contacts_only: Meet only the other hand, and the keyboard with fingertips and
            middle phalanges.
    """
    table = load_table("shadow_hands")
    hand = table[side]
    root = mjcf.RootElement(model=f"{hand['prefix']}_shadow_hand")
    root.compiler.angle = "radian"
    root.default.joint.set_attributes(**table["joint_defaults"])
    root.default.geom.set_attributes(
        contype=_KEYBOARD, conaffinity=_KEYBOARD, rgba=_SKIN_COLOR, **table["geom_defaults"]
    )
    root.asset.add("mesh", name="forearm", vertex=_hull_vertices(table["forearm_hull_rings"]))
    reduced = _ActionSpace.reduced(table["reduced_action_space"])
    space = reduced if reduced_action_space else _ActionSpace()
    for body in hand["bodies"]:
        masks = _playing_masks(side, body["name"]) if playing_contacts_only else {}
        _add_body(root, body, float(gravity_compensation), space, masks)
    if coupled_friction_only:
        for joint in root.find_all("joint"):
            if not joint.name.endswith(_COUPLED_JOINTS):
                joint.frictionloss = 0.0
    for pair in hand["contact_excludes"]:
        root.contact.add("exclude", body1=pair[0], body2=pair[1])
    for actuator in hand["actuators"]:
        _add_actuator(root, actuator, space)
    return root


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
    """Which joints move, and how far; joints are known by the ends of their names."""

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


def _add_body(
    root: mjcf.RootElement,
    spec: dict[str, Any],
    gravcomp: float,
    space: _ActionSpace,
    masks: dict[str, int],
) -> None:
    parent = root.find("body", spec["parent"]) if spec["parent"] else root.worldbody
    body = parent.add(
        "body", name=spec["name"], pos=spec["pos"], quat=spec["quat"], gravcomp=gravcomp
    )
    body.add("inertial", **spec["inertial"])
    for joint in spec["joints"]:
        if space.has(joint["name"]):
            limits = space.range_of(joint["name"], joint["range"])
            body.add("joint", **{**joint, "range": limits})
    for geom in spec["geoms"]:
        mesh = {"mesh": "forearm"} if geom["type"] == "mesh" else {}
        body.add("geom", **{**geom, **mesh, **masks})
    if "fingertip" in spec:
        finger = spec["name"].split("_")[1]
        body.add("site", name=f"{finger}_site", pos=spec["fingertip"], size=[0.004], group=4)


def _add_actuator(root: mjcf.RootElement, spec: dict[str, Any], space: _ActionSpace) -> None:
    """Add a position servo on a joint, or on the sum of two joints (a fixed tendon)."""
    joints = spec["joints"]
    if not space.has(joints[0]):
        return
    limits = space.range_of(joints[0], spec["ctrlrange"])
    settings = {"name": spec["name"], "kp": spec["kp"], "ctrlrange": limits}
    if "forcerange" in spec:
        settings["forcerange"] = spec["forcerange"]
    if len(joints) == 1:
        root.actuator.add("position", joint=joints[0], **settings)
        return
    tendon = root.tendon.add("fixed", name=spec["name"].replace("_A_", "_T_"))
    for joint in joints:
        tendon.add("joint", joint=joint, coef=1.0)
    root.actuator.add("position", tendon=tendon, **settings)


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
