"""Batched forward kinematics of one hand: fingertips and their Jacobians.

MuJoCo computes one posture at a time. A plan needs those of a whole stretch in every iteration;
for the some 120 of a stretch, arrays take half of the time of MuJoCo on a model of the hand alone.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.arrays import ComplexArray, FloatArray, IntArray
from sb3_piano.engine import mujoco
from sb3_piano.hands.forearm import TurnedForearm, rotation_matrix
from sb3_piano.hands.spec import HandSpec

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)
_EXACT = 1e-12  # smaller values are rounding errors, of unit vectors and m
_EVEN_STEPS = 3
_LONGEST_EVEN_STEP = 0.3  # rad
_STRAIGHT = 1e-7  # square of a slope, m per rad, below which a finger counts as straight

_Ways = tuple[tuple[int, float], ...]
"""A vector as its nonzero components: axis and length."""


class _Link(NamedTuple):
    """Body, or a part of it, with its pose in its parent, both numbered within the chain.

    A body with several joints, such as a forearm, has a link for each. The frame of a link with a
    hinge is rotated so that the hinge is the third axis: rotations are cheap then.
    """

    parent: int
    offset: _Ways
    rotation: FloatArray
    is_aligned: bool
    """Whether its frame is parallel to its parent's with its joints at 0."""
    joint: int
    """Its joint in the hand; -1 for none."""


class _Bends(NamedTuple):
    """The k fingers whose last two joints share an actuator; their last three joints are parallel.

    Positions in the plane of a finger are complex numbers, with its first link on the real axis.
    """

    knuckle: IntArray
    """(k,) actuator of the joint before the two."""
    both: IntArray
    """(k,) shared actuator of the two joints."""
    middle: IntArray
    """(k,) the first of the two joints."""
    lengths: FloatArray
    """(3, k) lengths of the links after the knuckle, m."""


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
        place = scene.sides.index(("right", "left")[hand])
        count = model.nu // len(scene.sides)
        self.actuators = np.arange(count, dtype=np.intp) + place * count
        """(n,) indices of the hand's actuators in the scene."""
        self.low, self.high = model.actuator_ctrlrange[self.actuators].T.copy()
        """(n,) ends of the control ranges; rad, or m for the sliders."""
        self.joint_ids = scene.joints[place]
        """(m,) indices of the hand's joints in the model."""
        h = len(scene.sides)
        moves = scene.actuator_of_joint.reshape(h, count, h, -1)[place, :, place].copy()
        self._actuator_of_joint = moves
        share = moves / (moves * moves).sum(axis=1, keepdims=True)
        self.joint_of_actuator = np.ascontiguousarray(share.T)
        """(m, n) matrix from actuator to joint positions; the joints of a tendon share equally."""
        self.names = tuple(self.spec.short(model.actuator(int(i)).name) for i in self.actuators)
        """Short names of the actuators."""
        self.roles = tuple(scene.actuator_role[i] for i in self.actuators)
        """Roles of the actuators."""
        self.along = self.roles.index("along")
        """Index of the actuator that slides along the keyboard."""
        self.sign = 1 if hand == 0 else -1
        """1 for the right hand, whose little finger is farthest along y; -1 for the left hand."""
        assert not model.jnt_pos[self.joint_ids].any(), "joints are at their bodies' origins"
        sliders = np.flatnonzero(model.jnt_type[self.joint_ids] != _HINGE).tolist()
        self._slides = {j: _ways(model.jnt_axis[self.joint_ids[j]]) for j in sliders}
        """Axes of the sliders in their bodies' frames. A hinge is its link's third axis, see
        `_Link`."""
        actuators = np.abs(self.joint_of_actuator).argmax(axis=1).tolist()
        self._actuator = [(a, float(self.joint_of_actuator[j, a])) for j, a in enumerate(actuators)]
        """Actuator of each joint, and the joint's share of its motion."""
        geoms = scene.fingertip_geom.reshape(len(scene.sides), -1)[place]
        self.radius = model.geom_size[geoms, 0].copy()
        """(f,) radius of each fingertip, m."""
        self._build_chains(model, geoms)
        self._bends = self._find_bends()
        self._place_arm(model)
        self.middle = float(self.arm(np.zeros((1, self.size)))[0])
        """Place of the forearm, and of the middle finger, with all joints at 0, m."""

    @property
    def size(self) -> int:
        """Number of actuators of the hand."""
        return len(self.actuators)

    def arm(self, positions: FloatArray) -> FloatArray:
        """Compute the forearm's place across the keys at (s, n) actuator positions, (s,) m.

        The place of a turned forearm is that of a straight one as near to the other forearm.
        """
        place = self._arm_offset + positions @ self.arm_slope
        return np.asarray(place if self._turned is None else place + self._turned(positions)[0])

    def arm_slopes(self, positions: FloatArray) -> FloatArray:
        """Compute the derivatives of :meth:`arm` by the actuators, (s, n), or (n,) if constant."""
        if self._turned is None:
            return self.arm_slope
        slopes = np.tile(self.arm_slope, (len(positions), 1))
        slopes[:, self._turned.actuator] = self._turned(positions)[1]
        return slopes

    def slider_for_arm(self, place: FloatArray) -> FloatArray:
        """Compute the along-keyboard slider's position from the forearm's place, (s,) m."""
        at = (place - self._arm_offset) / self.arm_slope[self.along]
        return np.clip(at, self.low[self.along], self.high[self.along])

    def fingertips(self, positions: FloatArray) -> FloatArray:
        """Compute the fingertips in the world at (s, n) actuator positions, (s, f, 3) m."""
        _, places, frames = self._chain(positions)
        return _postures_first(self._tips(places, frames))

    def fingertips_and_jacobian(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the fingertips at (s, n) positions, (s, f, 3) m, and Jacobians, (s, f, 3, n)."""
        axes, places, frames = self._chain(positions)
        tips = self._tips(places, frames)
        slopes = np.zeros((len(tips), 3, self.size, len(positions)))
        for finger, joints in enumerate(self._joints_above):
            for j in joints:
                x, y, z = axis = axes[j]
                if j in self._slides:
                    slope = axis
                else:
                    right, up, out = tips[finger] - places[self._link_of_joint[j]]
                    slope = np.stack([y * out - z * up, z * right - x * out, x * up - y * right])
                actuator, share = self._actuator[j]
                slopes[finger, :, actuator] += share * slope
        return _postures_first(tips), _postures_first(slopes)

    def even_positions(self, joints: FloatArray) -> FloatArray:
        """Compute actuator positions with the same fingertips as at joint positions.

        In a simulation two joints with a shared actuator need not bend equally, so their sum does
        not determine the tip. The result has equally bent joints, with the knuckle adjusted so that
        the tip stays in place.

        Args:
            joints: (..., m) positions of the hand's joints, rad or m.

        Returns:
            (..., n) rad or m.
        """
        positions = np.asarray(joints @ self._actuator_of_joint.T)
        knuckle, both, first_of_both, (first, second, third) = self._bends

        def tip(middle: FloatArray, end: FloatArray) -> ComplexArray:
            """Compute the tips from the angles of the second and the third link."""
            return np.asarray(first + second * np.exp(1j * middle) + third * np.exp(1j * end))

        even = positions[..., both]
        wanted = tip(joints[..., first_of_both], even)
        for _ in range(_EVEN_STEPS):  # Newton's method, for the tip's distance from the knuckle
            found = tip(even / 2, even)
            distance = np.abs(found)
            turned = 1j * (second / 2 * np.exp(0.5j * even) + third * np.exp(1j * even))
            slope = (found.conj() * turned).real / distance
            # The slope is 0 at a straight finger, which no bend makes longer.
            change = (np.abs(wanted) - distance) * slope / (slope**2 + _STRAIGHT)
            even = even + np.clip(change, -_LONGEST_EVEN_STEP, _LONGEST_EVEN_STEP)
            even = np.clip(even, self.low[both], self.high[both])
        positions[..., both] = even
        positions[..., knuckle] += np.angle(wanted / tip(even / 2, even))
        return positions

    def _find_bends(self) -> _Bends:
        """Find the fingers whose last two joints share an actuator."""
        found = []
        for offset, above in zip(self._tip_offset, self._joints_above, strict=True):
            knuckle, middle, end = ((j, self._actuator[j][0]) for j in above[-3:])
            if middle[1] == end[1]:
                links = (self._links[self._link_of_joint[j]].offset for j, _ in (middle, end))
                lengths = [math.hypot(*(way for _, way in ways)) for ways in (*links, offset)]
                found.append((knuckle[1], end[1], middle[0], lengths))
        numbers = np.array([each[:3] for each in found], dtype=np.intp).reshape(-1, 3)
        lengths_of = np.array([each[3] for each in found]).reshape(-1, 3)
        knuckles, both, middles = numbers.T
        return _Bends(knuckles, both, middles, lengths_of.T)

    def _chain(
        self, positions: FloatArray
    ) -> tuple[dict[int, FloatArray], list[FloatArray], list[FloatArray]]:
        """Compute the joints' axes and the links' places, (3, s), and frames, (3 axes, 3, s).

        The s postures are the last axis, over which NumPy's inner loops run.
        """
        angles = self.joint_of_actuator @ positions.T
        sines, cosines = np.sin(angles), np.cos(angles)
        axes, places, frames = dict[int, FloatArray](), list[FloatArray](), list[FloatArray]()
        for link in self._links:
            if link.parent < 0:
                columns = np.repeat(link.rotation.T[..., None], len(positions), axis=2)
                place = _moved(np.zeros((3, len(positions))), columns, link.offset)
            else:
                columns = frames[link.parent]
                place = _moved(places[link.parent], columns, link.offset)
                if not link.is_aligned:
                    rows = columns.reshape(3, -1)
                    columns = (link.rotation.T @ rows).reshape(columns.shape)
            j = link.joint
            if j in self._slides:
                axes[j] = _moved(np.zeros_like(place), columns, self._slides[j])
                place = place + angles[j] * axes[j]
            elif j >= 0:
                one, other, axes[j] = columns
                turned = cosines[j] * one + sines[j] * other
                columns = np.stack([turned, cosines[j] * other - sines[j] * one, axes[j]])
            places.append(place)
            frames.append(columns)
        return axes, places, frames

    def _tips(self, places: list[FloatArray], frames: list[FloatArray]) -> FloatArray:
        """Compute the fingertips, (f, 3, s) m."""
        tips = zip(self._tip_link, self._tip_offset, strict=True)
        return np.stack([_moved(places[link], frames[link], offset) for link, offset in tips])

    def _place_arm(self, model: mujoco.MjModel) -> None:
        along, driven = self.along, self.joint_ids[self.joint_of_actuator.argmax(axis=0)].tolist()
        body = int(model.jnt_bodyid[driven[along]])
        self._arm_offset = float(model.body_pos[body, 1])
        self.arm_slope = np.zeros(self.size)
        """(n,) derivatives of the forearm's place across the keys by the actuators."""
        axis = rotation_matrix(model.body_quat[body]) @ model.jnt_axis[driven[along]]
        self.arm_slope[along] = axis[1]
        self._turned = None
        if "yaw" in self.roles:
            yaw = self.roles.index("yaw")
            self._turned = TurnedForearm.of(model, driven[yaw], yaw, self.sign)

    def _build_chains(self, model: mujoco.MjModel, geoms: IntArray) -> None:
        """List the links from the hand's root to its fingertips, parents first."""
        tip_bodies = model.geom_bodyid[geoms].tolist()
        chains = [_path_from_world(model, body) for body in tip_bodies]
        order = {int(j): i for i, j in enumerate(self.joint_ids)}
        self._links: list[_Link] = []
        # Of each body: its last link, and that link's rotation in the body's frame.
        number, turn = {0: -1}, {0: np.eye(3)}
        for body in sorted({body for chain in chains for body in chain}):  # parents have lower ids
            above = int(model.body_parentid[body])
            parent, turned = number[above], turn[above].T
            place, frame = model.body_pos[body], rotation_matrix(model.body_quat[body])
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])) or (-1,):
                j = order.get(joint, -1)
                is_hinge = j >= 0 and j not in self._slides
                turn[body] = _third_axis_to(model.jnt_axis[joint]) if is_hinge else np.eye(3)
                rotation = turned @ frame @ turn[body]
                aligned = np.allclose(rotation, np.eye(3), atol=_EXACT)
                self._links.append(_Link(parent, _ways(turned @ place), rotation, aligned, j))
                # The next link begins at this one.
                parent, turned = len(self._links) - 1, turn[body].T
                place, frame = np.zeros(3), np.eye(3)
            number[body] = parent
        self._link_of_joint = {
            link.joint: i for i, link in enumerate(self._links) if link.joint >= 0
        }
        joints_of = model.jnt_bodyid[self.joint_ids].tolist()
        self._joints_above = [
            [j for j in self._link_of_joint if joints_of[j] in chain] for chain in chains
        ]
        self._tip_link = [number[body] for body in tip_bodies]
        half, middle = model.geom_size[geoms, 1], model.geom_pos[geoms]
        axis = np.stack([rotation_matrix(turned)[:, 2] for turned in model.geom_quat[geoms]])
        ends = [np.linalg.norm(middle + side[:, None] * axis, axis=1) for side in (half, -half)]
        self.tip_along = np.where(ends[0] >= ends[1], half, -half)  # the end farther from the joint
        """(f,) offset of each fingertip from its capsule's middle along the axis, m."""
        tips = middle + axis * self.tip_along[:, None]
        pairs = zip(tip_bodies, tips, strict=True)
        self._tip_offset = [_ways(turn[body].T @ tip) for body, tip in pairs]


def _third_axis_to(axis: FloatArray) -> FloatArray:
    """Compute a rotation from the third axis to another axis, (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, axis)
    return rotation_matrix(quaternion)


def _ways(offset: FloatArray) -> _Ways:
    return tuple((int(i), float(offset[i])) for i in np.flatnonzero(np.abs(offset) > _EXACT))


def _moved(place: FloatArray, columns: FloatArray, offset: _Ways) -> FloatArray:
    """Move places, (3, s) m, by an offset in frames, (3 axes, 3, s)."""
    for axis, length in offset:
        place = place + length * columns[axis]
    return place


def _postures_first(array: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.moveaxis(array, -1, 0))


def _path_from_world(model: mujoco.MjModel, body: int) -> list[int]:
    return [*_path_from_world(model, int(model.body_parentid[body])), body] if body > 0 else []
