"""MuJoCo specification of a hand from its MJCF, with variants by the roles of its parts."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from typing import Any

from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, near_names, one_line
from sb3_piano.hands.mirror import read_mirrored
from sb3_piano.hands.spec import SPEC_FILE, HandSpec, Side

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
    spec = _read(hand, side)
    _check(spec, hand, side)
    _remove(spec, hand, set(hand.forearm.joints.values()) - set(forearm_dofs))
    if reduced_action_space:
        _reduce(spec, hand)
    for body in spec.bodies[1:]:
        body.gravcomp = float(gravity_compensation)
    if coupled_friction_only:
        _drop_friction(spec, hand)
    if playing_contacts_only:
        playing = {link for links in hand.fingers.values() for link in links}
        for geom in spec.geoms:
            _mask(geom, side, meets_keys=hand.short(geom.parent.name) in playing)
    if capsule_forearm:
        _take_capsule(spec, hand)
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
    for kind, elements, names in named:
        known = {hand.short(element.name) for element in elements}
        for name in names:
            if name not in known:
                raise ConfigError(
                    f"'{hand.folder / SPEC_FILE}' names the {kind} {name!r}, which "
                    f"'{spec.modelname}' does not have.{near_names(name, known)} Expected one of "
                    f"{', '.join(sorted(known))}."
                )
    for body in spec.bodies[1:]:
        if not _is_simple(body):
            raise ConfigError(
                f"The joints of {body.name!r} of '{spec.modelname}' do not fit: expected sliders, "
                "then hinges, at the body's origin."
            )
        if hand.short(body.name) in hand.tips and not _is_fingertip(body):
            raise ConfigError(
                f"The fingertip {body.name!r} of '{spec.modelname}' is none: expected a link whose "
                "first geom is a capsule, with one site."
            )


def _is_simple(body: mujoco.MjsBody) -> bool:
    """Check that a body has sliders, then hinges, all at its origin."""
    kinds = [mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE]
    order = [kinds.index(j.type) if j.type in kinds else -1 for j in body.joints]
    is_ordered = order == sorted(order) and -1 not in order
    return is_ordered and not any(joint.pos.any() for joint in body.joints)


def _is_fingertip(body: mujoco.MjsBody) -> bool:
    first = next(iter(body.geoms), None)
    is_capsule = first is not None and first.type == mujoco.mjtGeom.mjGEOM_CAPSULE
    return is_capsule and len(body.sites) == 1


def _reduce(spec: mujoco.MjSpec, hand: HandSpec) -> None:
    """Remove joints and their actuators, and narrow the ranges of others."""
    reduced = hand.reduced_action_space
    _remove(spec, hand, reduced.removed)
    for elements, name_of in ((spec.actuators, "target"), (spec.joints, "name")):
        for element in elements:
            name = hand.short(getattr(element, name_of))
            if name in reduced.ranges:
                limits = "ctrlrange" if name_of == "target" else "range"
                setattr(element, limits, reduced.ranges[name])


def _remove(spec: mujoco.MjSpec, hand: HandSpec, joints: Container[str]) -> None:
    """Remove joints and their actuators."""
    for elements, name_of in ((spec.actuators, "target"), (spec.joints, "name")):
        for element in list(elements):
            if hand.short(getattr(element, name_of)) in joints:
                spec.delete(element)


def _drop_friction(spec: mujoco.MjSpec, hand: HandSpec) -> None:
    for joint in spec.joints:
        if hand.short(joint.name) not in hand.coupled:
            joint.frictionloss = 0.0


def _take_capsule(spec: mujoco.MjSpec, hand: HandSpec) -> None:
    """Replace the forearm's meshes by the hand's capsule, if it has one."""
    capsule = hand.forearm.capsule
    for geom in spec.geoms:
        on_forearm = hand.short(geom.parent.name) == hand.forearm.body
        if capsule is not None and on_forearm and geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_CAPSULE, ""
            geom.size, geom.pos = [*capsule.size, 0], capsule.pos


def _mask(geom: mujoco.MjsGeom, side: Side, *, meets_keys: bool) -> None:
    """Let a geom of a hand collide with the other hand, and with the keyboard if ``meets_keys``.

    Two geoms collide if the contype of one shares a bit with the conaffinity of the other, so one
    bit of the left hand's contype and the right hand's conaffinity is enough.
    """
    keyboard = _KEYBOARD if meets_keys else 0
    if side == "right":
        geom.contype, geom.conaffinity = keyboard, _OTHER_HAND
    else:
        geom.contype, geom.conaffinity = keyboard | _OTHER_HAND, 0
