"""Batched forward kinematics of one hand: fingertips and their Jacobians.

MuJoCo computes one posture at a time. A plan needs those of a whole stretch in every iteration;
for the some 120 of a stretch, arrays take half of the time of MuJoCo on a model of the hand alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.engine import mujoco
from sb3_piano.hands.spec import HandSpec

_SLIDER = int(mujoco.mjtJoint.mjJNT_SLIDE)
_EXACT = 1e-12  # smaller values are rounding errors, of unit vectors and m

Ways = tuple[tuple[int, float], ...]
"""A vector as its nonzero components: axis and length."""


class Link(NamedTuple):
    """Body, or a part of it, with its pose in its parent.

    A body with several joints, such as a forearm, has a link for each. The frame of a link with a
    hinge is rotated so that the hinge is the third axis: rotations are cheap then.
    """

    parent: int
    """Index of its parent."""
    offset: Ways
    rotation: FloatArray | None
    """``None`` if its frame is parallel to its parent's with its joint at 0."""
    joint: int
    """Its joint in the hand; -1 for none."""
    slide: Ways
    """Axis of a slider in its frame; empty for others."""


class HandKinematics:
    """Forward kinematics of the f fingertips of a hand (0 right, 1 left) from actuator positions.

    A fingertip is the centre of the sphere at the far end of the last finger link: at any angle of
    the finger, a surface that it touches below is one radius away. Two joints with a shared
    actuator are assumed to bend equally.
    """

    def __init__(self, scene: Any, hand: int):
        """Take a hand of a ``PianoScene``."""
        model, self.hand = scene.model, hand
        self.spec: HandSpec = scene.hand
        """Specification of the hand, with the roles of its parts."""
        h, place = len(scene.sides), scene.sides.index(("right", "left")[hand])
        self.size = model.nu // h
        """Number n of its actuators."""
        self.actuators = np.arange(self.size, dtype=np.intp) + place * self.size
        """(n,) indices of the hand's actuators in the scene."""
        self.low, self.high = model.actuator_ctrlrange[self.actuators].T.copy()
        """(n,) ends of the control ranges; rad, or m for the sliders."""
        self.joint_ids = scene.joints[place]
        """(m,) indices of the hand's joints in the model."""
        moves = scene.actuator_of_joint.reshape(h, self.size, h, -1)[place, :, place].copy()
        self.actuator_of_joint: FloatArray = moves
        """(n, m) matrix from joint to actuator positions."""
        share = moves / (moves * moves).sum(axis=1, keepdims=True)
        self.joint_of_actuator = np.ascontiguousarray(share.T)
        """(m, n) matrix from actuator to joint positions; the joints of a tendon share equally."""
        self.driver: list[int] = np.abs(self.joint_of_actuator).argmax(axis=1).tolist()
        """Actuator of each joint."""
        self.names = tuple(self.spec.short(model.actuator(int(i)).name) for i in self.actuators)
        """Short names of the actuators."""
        self.roles = tuple(scene.actuator_role[i] for i in self.actuators)
        """Roles of the actuators."""
        self.along = self.roles.index("along")
        """Index of the actuator that slides along the keyboard."""
        self.sign = 1 if hand == 0 else -1
        """1 for the right hand, whose little finger is farthest along y; -1 for the left hand."""
        slider = self.joint_ids[self.driver.index(self.along)]
        arm = model.jnt_bodyid[slider]
        self.middle = float(model.body_pos[arm, 1])
        """Place of the forearm, and of the middle finger, with all joints at 0, m."""
        self.slope = float((rotation_matrix(model.body_quat[arm]) @ model.jnt_axis[slider])[1])
        """Derivative of the forearm's place across the keys by the slider along the keyboard."""
        self._find_chains(model, scene.fingertip_geom.reshape(h, -1)[place])

    def fingertips(self, positions: FloatArray) -> FloatArray:
        """Compute the fingertips in the world at (s, n) actuator positions, (s, f, 3) m."""
        return _postures_first(self._pose(positions)[0])

    def fingertips_and_jacobian(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the fingertips at (s, n) positions, (s, f, 3) m, and Jacobians, (s, f, 3, n)."""
        tips, places, axes = self._pose(positions)
        slopes = np.zeros((len(tips), 3, self.size, len(positions)))
        for finger, (path, _) in enumerate(self.chains):
            for i in path:
                joint = self.links[i].joint
                if joint < 0:
                    continue
                x, y, z = slope = axes[i]
                if not self.links[i].slide:
                    right, up, out = tips[finger] - places[i]
                    slope = np.stack([y * out - z * up, z * right - x * out, x * up - y * right])
                actuator = self.driver[joint]
                slopes[finger, :, actuator] += self.joint_of_actuator[joint, actuator] * slope
        return _postures_first(tips), _postures_first(slopes)

    def _pose(self, positions: FloatArray) -> tuple[FloatArray, list[FloatArray], list[FloatArray]]:
        """Compute the fingertips, (f, 3, s), and each link's place and its joint's axis, (3, s).

        The s postures are the last axis, over which NumPy's inner loops run.
        """
        angles = self.joint_of_actuator @ positions.T
        sines, cosines = np.sin(angles), np.cos(angles)
        origin = np.zeros((3, len(positions)))
        places, axes = [origin], [origin]
        frames = [np.repeat(np.eye(3)[..., None], len(positions), axis=2)]  # (3 axes, 3, s)
        for parent, offset, rotation, j, slide in self.links[1:]:
            columns = frames[parent]
            place = _moved(places[parent], columns, offset)
            if rotation is not None:
                columns = (rotation.T @ columns.reshape(3, -1)).reshape(columns.shape)
            axis = columns[2]
            if slide:
                axis = _moved(origin, columns, slide)
                place = place + angles[j] * axis
            elif j >= 0:
                one, other, _ = columns
                turned = cosines[j] * one + sines[j] * other
                columns = np.stack([turned, cosines[j] * other - sines[j] * one, axis])
            places.append(place)
            axes.append(axis)
            frames.append(columns)
        tips = [_moved(places[path[-1]], frames[path[-1]], tip) for path, tip in self.chains]
        return np.stack(tips), places, axes

    def _find_chains(self, model: mujoco.MjModel, geoms: IntArray) -> None:
        """Find the links, and the fingertips at the far ends of capsules, in the last links."""
        joints = {joint: j for j, joint in enumerate(self.joint_ids.tolist())}
        self.links = [Link(-1, (), None, -1, ())]
        """The world, and the links of the hand, parents first."""
        # Of each body: the path of links to it. Of each link: its frame's rotation in the body's.
        paths, turns = {0: [0]}, [np.eye(3)]
        tip_bodies = model.geom_bodyid[geoms].tolist()
        root = model.body_rootid[tip_bodies[0]]
        for body in np.flatnonzero(model.body_rootid == root).tolist():  # parents have lower ids
            path = list(paths[int(model.body_parentid[body])])
            place, frame = model.body_pos[body], rotation_matrix(model.body_quat[body])
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])) or (-1,):
                j, axis, back = joints.get(joint, -1), model.jnt_axis[joint], turns[path[-1]].T
                is_slider = j >= 0 and model.jnt_type[joint] == _SLIDER
                turn = np.eye(3) if j < 0 or is_slider else _third_axis_to(axis)
                rotation = back @ frame @ turn
                turned = None if np.allclose(rotation, np.eye(3), atol=_EXACT) else rotation
                slide = _ways(axis) if is_slider else ()
                self.links.append(Link(path[-1], _ways(back @ place), turned, j, slide))
                path.append(len(turns))
                turns.append(turn)
                place, frame = np.zeros(3), np.eye(3)  # the next link begins at this one
            paths[body] = path
        self.radius, half = model.geom_size[geoms, :2].T.copy()
        """(f,) radius of each fingertip, m."""
        middle = model.geom_pos[geoms]
        axis = np.stack([rotation_matrix(turned)[:, 2] for turned in model.geom_quat[geoms]])
        is_outwards = (middle * axis).sum(axis=1) >= 0  # of the two ends, farther from the joint
        self.tip_along = np.where(is_outwards, half, -half)
        """(f,) offset of each fingertip from its capsule's middle along the axis, m."""
        tips = middle + axis * self.tip_along[:, None]
        self.chains = [
            (paths[body], _ways(turns[paths[body][-1]].T @ tip))
            for body, tip in zip(tip_bodies, tips, strict=True)
        ]
        """Of each finger: the path of links from the world on, and its tip in the last one, m."""


def rotation_matrix(quaternion: Any) -> FloatArray:
    """Convert a quaternion (w first) to a rotation matrix, (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _third_axis_to(axis: FloatArray) -> FloatArray:
    """Compute a rotation from the third axis to another axis, (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, axis)
    return rotation_matrix(quaternion)


def _ways(offset: FloatArray) -> Ways:
    return tuple((int(i), float(offset[i])) for i in np.flatnonzero(np.abs(offset) > _EXACT))


def _moved(place: FloatArray, columns: FloatArray, offset: Ways) -> FloatArray:
    """Move places, (3, s) m, by an offset in frames, (3 axes, 3, s)."""
    for axis, length in offset:
        place = place + length * columns[axis]
    return place


def _postures_first(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.moveaxis(array, -1, 0))
