"""Left hand as the mirror image of the right hand."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.hands.forearm import rotation_matrix
from sb3_piano.hands.spec import HandSpec

_ACROSS = 1
"""World axis along the keyboard, y. The mirror plane is y = 0."""


def read_mirrored(hand: HandSpec) -> mujoco.MjSpec:
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
    axis = "xyz".index(hand.mirror)
    roots = [body.name for body in spec.worldbody.bodies]
    for body in spec.bodies[1:]:
        outer = _ACROSS if body.name in roots else axis
        body.pos, body.quat = _mirrored(body.pos, outer), _turned(body.quat, outer, axis)
        body.ipos, body.iquat = _mirrored(body.ipos, axis), _turned(body.iquat, axis, axis)
    for element in (*spec.geoms, *spec.sites):
        element.pos, element.quat = _mirrored(element.pos, axis), _turned(element.quat, axis, axis)
        element.fromto[[axis, 3 + axis]] *= -1
    for mesh in spec.meshes:
        mesh.scale = _mirrored(mesh.scale, axis)
    along, roll = hand.forearm.joints["along"], hand.forearm.joints.get("roll")
    for joint in spec.joints:
        slides = joint.type == mujoco.mjtJoint.mjJNT_SLIDE
        # A mirror reverses the sense of a rotation.
        joint.axis = _mirrored(joint.axis, axis) * (1 if slides else -1)
        joint.pos = _mirrored(joint.pos, axis)
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


def _mirrored(vector: Any, axis: int) -> FloatArray:
    return np.where(np.arange(3) == axis, -1.0, 1.0) * vector


def _turned(quaternion: Any, outer: int, inner: int) -> FloatArray:
    """Mirror a rotation between two frames, each along its own axis."""
    matrix, turned = rotation_matrix(quaternion), np.empty(4)
    matrix[outer] *= -1
    matrix[:, inner] *= -1
    mujoco.mju_mat2Quat(turned, matrix.reshape(9))
    return turned
