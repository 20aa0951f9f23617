"""MuJoCo specification of a hand from its MJCF: its variants, and its mirror image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.hands.kinematics import rotation_matrix
from sb3_piano.hands.spec import SPEC_FILE, HandSpec, ReducedActions, Side
from sb3_piano.settings import refuse_unknown

# Bits of contype and conaffinity. By default every geom of a hand collides with all others of both
# hands, and with the keyboard, whose conaffinity is 1.
_KEYBOARD, _OTHER_HAND = 1, 2

_MIRROR = np.array([1.0, -1.0, 1.0])  # of the world: y is along the keyboard, and 0 in its middle


def build_hand(
    hand: HandSpec,
    side: Side,
    profile: Any,
    *,
    reduced_action_space: bool,
    forearm_dofs: Sequence[str],
    gravity_compensation: bool,
) -> mujoco.MjSpec:
    """Make the specification of a hand, to attach to a scene.

    Args:
        hand: The hand.
        side: ``"right"`` or ``"left"``.
        profile: A ``PhysicsProfile``, for its simplifications of friction, contacts and forearms.
        reduced_action_space: Remove joints and narrow others as in the hand's specification.
        forearm_dofs: The forearm's joints; others are removed.
        gravity_compensation: Balance the weight of every body of the hand by a force.

    Raises:
        ConfigError: If MuJoCo cannot read the hand's file, or it lacks parts named in ``hand.yml``.
    """
    spec = _read(hand, side)
    _check(spec, hand, side)
    reduced = hand.reduced_action_space if reduced_action_space else ReducedActions()
    removed = {*hand.forearm.joints.values()} - {*forearm_dofs} | {*reduced.removed}
    for element in [*spec.actuators, *spec.joints]:
        is_joint = isinstance(element, mujoco.MjsJoint)
        name = hand.short(element.name if is_joint else element.target)
        if name in removed:
            spec.delete(element)
        elif name in reduced.ranges:
            setattr(element, "range" if is_joint else "ctrlrange", reduced.ranges[name])
    for body in spec.bodies[1:]:
        body.gravcomp = float(gravity_compensation)
    for joint in spec.joints if profile.coupled_friction_only else ():
        if hand.short(joint.name) not in hand.coupled:
            joint.frictionloss = 0.0
    playing = {link for links in hand.fingers.values() for link in links}
    # Two geoms collide if the contype of one shares a bit with the conaffinity of the other, so one
    # bit of the left hand's contype and the right hand's conaffinity is enough for the two hands.
    other = _OTHER_HAND if side == "left" else 0
    capsule = hand.forearm.capsule if profile.capsule_forearms else None
    for geom in spec.geoms:
        link = hand.short(geom.parent.name)
        if profile.playing_contacts_only:
            geom.contype = (link in playing) * _KEYBOARD | other
            geom.conaffinity = _OTHER_HAND - other
        is_mesh = geom.type == mujoco.mjtGeom.mjGEOM_MESH
        if capsule is not None and link == hand.forearm.body and is_mesh:
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_CAPSULE, ""
            geom.size, geom.pos = [*capsule.size, 0], capsule.pos
    return spec


def _read(hand: HandSpec, side: Side) -> mujoco.MjSpec:
    file = hand.folder / f"{side}.xml"
    try:
        if side == "left" and not file.is_file():
            return _read_mirrored(hand)
        return mujoco.MjSpec.from_file(str(file))
    except (OSError, ValueError) as error:
        raise ConfigError(f"'{file}' is no hand: {one_line(error)}.") from error


def _read_mirrored(hand: HandSpec) -> mujoco.MjSpec:
    """Mirror the right hand's specification to a left hand, for hands without ``left.xml``.

    The links' frames are mirrored along :attr:`HandSpec.mirror`. Positive angles bend the same
    parts as on the right. As with RoboPianist's hands, the slider along the keyboard still moves to
    the right, and the forearm still rolls like the right one.

    Raises:
        ValueError: If MuJoCo cannot read the file, or it has elements that cannot be mirrored.
    """
    text = (hand.folder / "right.xml").read_text(encoding="utf-8")
    text = text.replace(f'"{hand.prefix["right"]}', f'"{hand.prefix["left"]}')
    spec = mujoco.MjSpec.from_string(text)
    spec.modelfiledir = str(hand.folder)  # folder of the mesh files
    _check_orientations(spec)
    flip = np.where(np.array(["x", "y", "z"]) == hand.mirror, -1.0, 1.0)
    for body in spec.bodies[1:]:
        outer = _MIRROR if body.parent.name == "world" else flip
        body.pos, body.quat = outer * body.pos, _turned(body.quat, outer, flip)
        body.ipos, body.iquat = flip * body.ipos, _turned(body.iquat, flip, flip)
    for element in (*spec.geoms, *spec.sites):
        element.pos, element.quat = flip * element.pos, _turned(element.quat, flip, flip)
        element.fromto *= np.tile(flip, 2)
    for mesh in spec.meshes:
        mesh.scale = flip * mesh.scale
    along, roll = hand.forearm.joints["along"], hand.forearm.joints.get("roll")
    for joint in spec.joints:
        slides = joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        # A mirror reverses the sense of a rotation.
        joint.axis, joint.pos = flip * joint.axis * (1 if slides else -1), flip * joint.pos
        if hand.short(joint.name) in (along, roll):
            joint.axis, joint.range = -joint.axis, -joint.range[::-1]
    for actuator in spec.actuators:
        if hand.short(actuator.target) in (along, roll):
            actuator.ctrlrange = -actuator.ctrlrange[::-1]
    return spec


def _check_orientations(spec: mujoco.MjSpec) -> None:
    """Raise a ValueError if orientations have a notation that is not supported here."""
    turned = [each.alt for each in (*spec.bodies, *spec.geoms, *spec.sites)]
    turned += [body.ialt for body in spec.bodies]
    is_quat = all(each.type == mujoco.mjtOrientation.mjORIENTATION_QUAT for each in turned)
    if spec.frames or not is_quat or not np.isnan([b.fullinertia[0] for b in spec.bodies]).all():
        raise ValueError(
            "it has no left.xml, and to be mirrored it has to be written with quat or fromto, "
            "without frames, fullinertia and other orientations"
        )


def _turned(quaternion: Any, outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Mirror a rotation between two frames, each along its own axis."""
    matrix, turned = outer[:, None] * rotation_matrix(quaternion) * inner, np.empty(4)
    mujoco.mju_mat2Quat(turned, matrix.ravel())
    return turned


def _check(spec: mujoco.MjSpec, hand: HandSpec, side: Side) -> None:
    """Check that a model has the parts that ``hand.yml`` names, and of the right kinds."""
    if not spec.modelname.startswith(hand.prefix[side]):
        raise ConfigError(
            f"The {side} hand of '{hand.folder}' is the model {spec.modelname!r}: expected a name "
            f"that begins with {hand.prefix[side]!r}."
        )
    reduced = hand.reduced_action_space
    joints = (*hand.forearm.joints.values(), *hand.wrist, *hand.abduction, *hand.coupled)
    links = [link for links in hand.fingers.values() for link in links]
    named: list[tuple[str, Any, Iterable[str]]] = [
        ("joint", spec.joints, (*joints, *reduced.removed, *reduced.ranges)),
        ("body", spec.bodies, (hand.forearm.body, *links)),
        ("actuator", spec.actuators, hand.rest.posture),
    ]
    place = f"'{spec.modelname}' in '{hand.folder / SPEC_FILE}'"
    for kind, elements, names in named:
        refuse_unknown(names, sorted({hand.short(e.name) for e in elements}), kind, place)
    kinds = [mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE]
    for body in spec.bodies[1:]:
        order = [kinds.index(j.type) if j.type in kinds else -1 for j in body.joints]
        if order != sorted(order) or -1 in order or any(j.pos.any() for j in body.joints):
            raise ConfigError(
                f"The joints of {body.name!r} of '{spec.modelname}' do not fit: expected sliders, "
                "then hinges, at the body's origin."
            )
        shapes = [geom.type for geom in body.geoms]
        is_tip = shapes[:1] == [mujoco.mjtGeom.mjGEOM_CAPSULE] and len(body.sites) == 1
        if hand.short(body.name) in hand.tips and not is_tip:
            raise ConfigError(
                f"The fingertip {body.name!r} of '{spec.modelname}' is none: expected a link whose "
                "first geom is a capsule, with one site."
            )
