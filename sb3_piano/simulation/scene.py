"""A compiled scene, and the index arrays through which it is read.

No MuJoCo name is looked up after the scene is built: everything an environment needs in a control
step is an index array or a constant array held here. The right hand comes before the left one; a
scene may have only one of them.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.engine import mujoco
from sb3_piano.hands import HandSpec
from sb3_piano.music.constants import NUM_FINGERS, NUM_KEYS
from sb3_piano.music.hands import HANDS, Hand, fingers_of

SIDES = HANDS
"""The hands in their order."""

FAR_AWAY = 1000.0
"""Coordinates of the fingertips of a hand that is not in the scene, m: near to nothing."""

TIP_TRAVEL = 0.06
"""Way of a fingertip when a finger's joint turns by a rad, about, m, and so what a forearm's slider
has to move to matter as much."""

FOREARM_TRAVEL = 0.4
"""The same when its forearm turns."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PianoScene:
    """A compiled MuJoCo model of a piano, hands or none, and what is needed to read its state."""

    model: mujoco.MjModel
    """MuJoCo's model."""
    sides: tuple[Hand, ...]
    """Hands of the scene, h of them: ``"right"`` before ``"left"``. Without any, the actuators are
    those of the keys."""
    moving_keys: slice
    """Those of the 88 keys that move; all, unless the scene was compiled with rigid ones."""
    key_qpos: IntArray
    """(n,) address in ``qpos`` of the angle of each key that moves."""
    key_slice: slice
    """The same addresses as a slice of ``qpos``, which gives a view."""
    key_min_angle: FloatArray
    """(n,) angle of each key that moves when it is up, rad: 0."""
    key_max_angle: FloatArray
    """(88,) angle of each key when fully down, rad; what it would be for a rigid one."""
    key_sounding_angle: FloatArray
    """(88,) angle from which on each key sounds, rad; no rigid one ever does."""
    key_geom: IntArray
    """(88,) geom of each key."""
    key_boxes: tuple[FloatArray, FloatArray, FloatArray]
    """Places of the keys when fully down (the rigid ones as they are): (88, 3) centres of their
    boxes in the world, m; (88, 3, 3) the boxes' axes in the world, as columns; (88, 3) half lengths
    along them, m."""
    key_press_offset: FloatArray
    """(88, 3) from a key geom's centre to the point where a finger should press it, m."""
    fingertip_site: IntArray
    """(5 h,) fingertip sites, in the order of ``fingers``."""
    fingertip_geom: IntArray
    """(5 h,) geoms of the last finger links, in the order of ``fingers``."""
    joints: tuple[IntArray, ...]
    """Joints of each hand, wrist to thumb, those of the forearm last."""
    actuator_of_joint: FloatArray
    """(nu, m) which actuator moves by how much with which joint, all hands' joints in the order of
    ``joint_qpos``: where the actuators are is this times where the joints are."""
    forearm_geoms: tuple[list[int], ...]
    """Shapes of each forearm."""
    forearm_reach: float
    """Forearms cannot touch while their first shapes are farther apart along the keyboard, m."""
    hand: HandSpec
    """The hand, and the roles of its parts."""
    slider_qpos: IntArray
    """(h,) addresses in ``qpos`` of the sliders along the keyboard."""
    options: Mapping[str, Any]
    """Arguments of :func:`~sb3_piano.simulation.compile_scene` that describe the scene."""

    @property
    def ctrl_low(self) -> FloatArray:
        """(nu,) lower ends of the control ranges; rad, or m for the sliders."""
        return np.asarray(self.model.actuator_ctrlrange[:, 0])

    @property
    def ctrl_high(self) -> FloatArray:
        """(nu,) upper ends of the control ranges; rad, or m for the sliders."""
        return np.asarray(self.model.actuator_ctrlrange[:, 1])

    @functools.cached_property
    def fingers(self) -> IntArray:
        """(5 h,) labels of the fingers that are there, ascending."""
        count = len(self.hand.fingers)
        fingers = [finger for side in self.sides for finger in fingers_of(side)[:count]]
        return np.array(fingers, dtype=np.intp)

    @functools.cached_property
    def joint_qpos(self) -> tuple[IntArray, ...]:
        """For each hand: addresses in ``qpos`` of its ``joints``."""
        return tuple(self.model.jnt_qposadr[joints].astype(np.intp) for joints in self.joints)

    @property
    def joint_names(self) -> tuple[tuple[str, ...], ...]:
        """For each hand: names of its ``joints``."""
        return tuple(tuple(self.model.joint(j).name for j in joints) for joints in self.joints)

    @property
    def joint_range(self) -> tuple[FloatArray, ...]:
        """For each hand: (n, 2) limits of its ``joints``, rad or m."""
        return tuple(self.model.jnt_range[joints] for joints in self.joints)

    @functools.cached_property
    def hand_qpos(self) -> IntArray:
        """(m,) addresses in ``qpos`` of all hands' joints, in the order of ``joint_qpos``."""
        return np.concatenate([np.empty(0, dtype=np.intp), *self.joint_qpos])

    @functools.cached_property
    def actuator_kind(self) -> npt.NDArray[np.str_]:
        """(nu,) what each actuator moves.

        It is a ``"finger"``, a ``"wrist"``, a ``"forearm"`` (by a slider) or an ``"elbow"`` (by a
        hinge of the forearm).
        """
        return np.array([kind_of(role) for role in self.actuator_role])

    @functools.cached_property
    def actuator_role(self) -> tuple[str, ...]:
        """What each actuator is for: the role of the first joint that it drives."""
        names = [name for names in self.joint_names for name in names]
        if not names:  # keys
            return ("finger",) * self.model.nu
        first = (self.actuator_of_joint != 0).argmax(axis=1).tolist()
        return tuple(self.hand.role(self.hand.short(names[joint])) for joint in first)

    def actuator_positions(self, joints: npt.NDArray[np.floating]) -> FloatArray:
        """Return where the actuators are, (nu,) rad or m; joints are as in ``hand_qpos``."""
        return np.asarray(self.actuator_of_joint @ joints)

    def key_angle(self, data: mujoco.MjData) -> FloatArray:
        """Return each key's angle, (88,) rad, clipped to its range (joint limits are soft)."""
        return self.key_angle_at(data.qpos)

    def key_angle_at(self, qpos: FloatArray) -> FloatArray:
        """Return each key's angle, (88,) rad, clipped to its range, at joint positions, (nq,)."""
        return self.clipped_key_angle(qpos[self.key_slice])

    def clipped_key_angle(self, angle: FloatArray) -> FloatArray:
        """Return each key's angle, (88,) rad, clipped to its range, from those that move, (n,)."""
        angle = np.maximum(angle, self.key_min_angle)
        if len(angle) < NUM_KEYS:
            angle, moving = np.zeros(NUM_KEYS), angle
            angle[self.moving_keys] = moving
        # On so few numbers three times as fast as np.clip, and as with plain numbers as bounds.
        return np.minimum(angle, self.key_max_angle)

    def sounding_at(self, angles: Iterable[bytes]) -> BoolArray:
        """Return which keys sound at angles of the moving ones (float64, rad), (n, 88) bool."""
        return self.angles_of(angles) >= self.key_sounding_angle

    def angles_of(self, angles: Iterable[bytes]) -> FloatArray:
        """Return angles of the moving keys (float64, rad) as those of all, (n, 88)."""
        moving = self.moving_keys
        rows = np.frombuffer(b"".join(angles)).reshape(-1, len(self.key_qpos))
        rigid = (moving.start, NUM_KEYS - moving.stop)
        return np.pad(rows, ((0, 0), rigid)) if any(rigid) else rows

    def fingertip_position(self, data: mujoco.MjData) -> FloatArray:
        """Return the world positions of the fingertips by label, (10, 3) m.

        Those of a hand that is not in the scene are ``FAR_AWAY``.
        """
        return self.by_finger(data.site_xpos.take(self.fingertip_site, axis=0))

    def by_finger(self, tips: FloatArray) -> FloatArray:
        """Return places of the fingers that are there, (5 h, 3) m, as those of all, (10, 3)."""
        if len(tips) == NUM_FINGERS:
            return tips
        everyone = np.full((NUM_FINGERS, 3), FAR_AWAY)
        everyone[self.fingers] = tips
        return everyone

    def press_point(self, data: mujoco.MjData, keys: IntArray) -> FloatArray:
        """Return where fingers should press the given keys: world positions, (n, 3) m."""
        geoms, offsets = self.press_geometry(keys)
        return np.asarray(data.geom_xpos[geoms] + offsets)

    def press_geometry(self, keys: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the geoms of the given keys, (...), and where on them to press, (..., 3) m."""
        return self.key_geom[keys], self.key_press_offset[keys]

    def forearms_touch(self, data: mujoco.MjData) -> bool:
        """Return whether a shape of one forearm touches one of the other."""
        if len(self.forearm_geoms) < len(SIDES):
            return False
        (right, left), position = self.forearm_geoms, data.geom_xpos
        apart = position.item(right[0], 1) - position.item(left[0], 1)
        if abs(apart) > self.forearm_reach:
            return False  # to ask for the contacts takes longer
        return any(
            (a in right and b in left) or (a in left and b in right)
            for a, b in data.contact.geom.tolist()
        )

    def copy(self) -> PianoScene:
        """Return the same scene with a model of its own, which may then be modified."""
        return dataclasses.replace(self, model=copy.copy(self.model))


_KINDS = {"along": "forearm", "across": "forearm", "up": "forearm", "wrist": "wrist"}
_KINDS |= dict.fromkeys(("roll", "pitch", "yaw"), "elbow")


def kind_of(role: str) -> str:
    """Return what a joint of a role moves, as ``PianoScene.actuator_kind`` has it."""
    return _KINDS.get(role, "finger")


def tip_unit(kind: str) -> float:
    """Return what moves a fingertip as far as a rad of a finger or a wrist, about; rad or m."""
    return {"forearm": TIP_TRAVEL, "elbow": TIP_TRAVEL / FOREARM_TRAVEL}.get(kind, 1.0)
