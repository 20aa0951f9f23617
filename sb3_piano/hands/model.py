"""MuJoCo specification of a hand from its MJCF, with variants by the roles of its parts."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from typing import Any

from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.hands.mirror import read_mirrored
from sb3_piano.hands.spec import SPEC_FILE, HandSpec, Side
from sb3_piano.settings import refuse_unknown

# Bits of contype and conaffinity. By default every geom of a hand collides with all others of both
# hands, and with the keyboard, whose conaffinity is 1.
_KEYBOARD, _OTHER_HAND = 1, 2


def build_hand(
    hand: HandSpec,
    side: Side,
    *,
    reduced_action_space: bool,
    forearm_dofs: Sequence[str],
    gravity_compensation: bool,
    coupled_friction_only: bool = False,
    playing_contacts_only: bool = False,
    capsule_forearm: bool = False,
) -> mujoco.MjSpec:
    """Make the specification of a hand, to attach to a scene.

    Args:
        hand: The hand.
        side: ``"right"`` or ``"left"``.
        reduced_action_space: Remove joints and narrow others as in the hand's specification.
        forearm_dofs: The forearm's joints; others are removed.
        gravity_compensation: Balance the weight of every body of the hand by a force.
        coupled_friction_only: Keep dry friction in coupled joints only, see
            :class:`~sb3_piano.simulation.physics.PhysicsProfile`.
        playing_contacts_only: Collide only with the other hand, and with the keyboard by the links
            listed in ``fingers``.
        capsule_forearm: Replace the forearm's mesh geoms by its capsule.

    Raises:
        ConfigError: If MuJoCo cannot read the hand's file, or it lacks parts named in ``hand.yml``.
    """
    spec, reduced = _read(hand, side), hand.reduced_action_space
    _check(spec, hand, side)
    _remove(spec, hand, set(hand.forearm.joints.values()) - set(forearm_dofs))
    if reduced_action_space:
        _remove(spec, hand, reduced.removed)
        for element, name, limits in _joints_and_actuators(spec, hand):
            if name in reduced.ranges:
                setattr(element, limits, reduced.ranges[name])
    for body in spec.bodies[1:]:
        body.gravcomp = float(gravity_compensation)
    for joint in spec.joints if coupled_friction_only else ():
        if hand.short(joint.name) not in hand.coupled:
            joint.frictionloss = 0.0
    playing = {link for links in hand.fingers.values() for link in links}
    for geom in spec.geoms:
        link = hand.short(geom.parent.name)
        if playing_contacts_only:
            # Two geoms collide if the contype of one shares a bit with the conaffinity of the
            # other, so one bit of the left hand's contype and the right hand's conaffinity is
            # enough for the two hands.
            other = _OTHER_HAND if side == "left" else 0
            geom.contype, geom.conaffinity = (
                (link in playing) * _KEYBOARD | other,
                _OTHER_HAND - other,
            )
        capsule = hand.forearm.capsule if capsule_forearm and link == hand.forearm.body else None
        if capsule is not None and geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_CAPSULE, ""
            geom.size, geom.pos = [*capsule.size, 0], capsule.pos
    return spec


def _read(hand: HandSpec, side: Side) -> mujoco.MjSpec:
    file = hand.folder / f"{side}.xml"
    try:
        if side == "left" and not file.is_file():
            return read_mirrored(hand)
        return mujoco.MjSpec.from_file(str(file))
    except (OSError, ValueError) as error:
        raise ConfigError(f"'{file}' is no hand: {one_line(error)}.") from error


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


def _joints_and_actuators(spec: mujoco.MjSpec, hand: HandSpec) -> Iterator[tuple[Any, str, str]]:
    """Yield each actuator and joint, the short name of its joint, and its attribute for limits."""
    for actuator in list(spec.actuators):
        yield actuator, hand.short(actuator.target), "ctrlrange"
    for joint in list(spec.joints):
        yield joint, hand.short(joint.name), "range"


def _remove(spec: mujoco.MjSpec, hand: HandSpec, joints: Container[str]) -> None:
    """Remove joints and their actuators."""
    for element, name, _ in _joints_and_actuators(spec, hand):
        if name in joints:
            spec.delete(element)
