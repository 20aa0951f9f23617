"""Compiled scene with the index arrays to read its state: names are looked up only once."""

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
"""Hands in order."""

FAR_AWAY = 1000.0
"""Coordinates of an absent hand's fingertips, m: far from all keys."""

TIP_TRAVEL = 0.06
"""Approximate path of a fingertip for 1 rad of a finger joint, m; a forearm slider moves as far for
the same effect."""

FOREARM_TRAVEL = 0.4
"""Approximate path of a fingertip for 1 rad of a forearm's turn, m."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class PianoScene:
    """Compiled MuJoCo model of a piano with or without hands, and indices to read its state."""

    model: mujoco.MjModel
    """MuJoCo's model."""
    sides: tuple[Hand, ...]
    """The h hands of the scene: ``"right"`` before ``"left"``. Without hands the actuators drive
    the keys."""
    moving_keys: slice
    """Moving keys among the 88; all, unless the scene was compiled with rigid ones."""
    key_qpos: IntArray
    """(n,) address in ``qpos`` of each moving key's angle."""
    key_slice: slice
    """The same addresses as a slice of ``qpos``, which gives a view."""
    key_min_angle: FloatArray
    """(n,) angle of each moving key when it is up, rad: 0."""
    key_max_angle: FloatArray
    """(88,) angle of each key when fully down, rad; for rigid keys, too."""
    key_sounding_angle: FloatArray
    """(88,) angle at and above which each key sounds, rad; rigid keys never reach it."""
    key_geom: IntArray
    """(88,) geom of each key."""
    key_boxes: tuple[FloatArray, FloatArray, FloatArray]
    """Boxes of the keys when fully down (rigid keys: at rest): (88, 3) centres in the world, m;
    (88, 3, 3) axes in the world, as columns; (88, 3) half lengths along the axes, m."""
    key_press_offset: FloatArray
    """(88, 3) from a key geom's centre to the point where a finger should press it, m."""
    fingertip_site: IntArray
    """(5 h,) fingertip sites, in the order of ``fingers``."""
    fingertip_geom: IntArray
    """(5 h,) geoms of the last finger links, in the order of ``fingers``."""
    joints: tuple[IntArray, ...]
    """Joints of each hand, wrist to thumb, with the forearm's last."""
    actuator_of_joint: FloatArray
    """(nu, m) matrix from joint positions, all hands' joints in the order of ``joint_qpos``, to
    actuator positions."""
    forearm_geoms: tuple[list[int], ...]
    """Geoms of each forearm."""
    forearm_reach: float
    """Largest distance of touching forearms' first geoms along the keyboard, m."""
    hand: HandSpec
    """Specification of the hand, with the roles of its parts."""
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
        """(5 h,) labels of the fingers in the scene, ascending."""
        count = len(self.hand.fingers)
        return np.array([f for side in self.sides for f in fingers_of(side)[:count]], dtype=np.intp)

    @functools.cached_property
    def joint_qpos(self) -> tuple[IntArray, ...]:
        """Addresses in ``qpos`` of each hand's ``joints``."""
        return tuple(self.model.jnt_qposadr[joints].astype(np.intp) for joints in self.joints)

    @property
    def joint_names(self) -> tuple[tuple[str, ...], ...]:
        """Names of each hand's ``joints``."""
        return tuple(tuple(self.model.joint(j).name for j in joints) for joints in self.joints)

    @property
    def joint_range(self) -> tuple[FloatArray, ...]:
        """(n, 2) limits of each hand's ``joints``, rad or m."""
        return tuple(self.model.jnt_range[joints] for joints in self.joints)

    @functools.cached_property
    def hand_qpos(self) -> IntArray:
        """(m,) addresses in ``qpos`` of all hands' joints, in the order of ``joint_qpos``."""
        return np.concatenate([np.empty(0, dtype=np.intp), *self.joint_qpos])

    @functools.cached_property
    def actuator_kind(self) -> npt.NDArray[np.str_]:
        """(nu,) kinds of the actuators, see :func:`kind_of`."""
        return np.array([kind_of(role) for role in self.actuator_role])

    @functools.cached_property
    def actuator_role(self) -> tuple[str, ...]:
        """Role of each actuator: that of the first joint that it drives."""
        names = [name for names in self.joint_names for name in names]
        if not names:  # keys
            return ("finger",) * self.model.nu
        first = (self.actuator_of_joint != 0).argmax(axis=1).tolist()
        return tuple(self.hand.role(self.hand.short(names[joint])) for joint in first)

    def actuator_positions(self, joints: npt.NDArray[np.floating]) -> FloatArray:
        """Compute actuator positions, (nu,) rad or m, from joints in the order of ``hand_qpos``."""
        return np.asarray(self.actuator_of_joint @ joints)

    def key_angle(self, data: mujoco.MjData) -> FloatArray:
        """Return each key's angle, (88,) rad, clipped to its range (joint limits are soft).

        Of ``Simulations`` as ``data`` it is (N, 88), and so with fingertips and press points.
        """
        return self.clipped_key_angle(data.qpos[..., self.key_slice])

    def clipped_key_angle(self, angle: FloatArray) -> FloatArray:
        """Return each key's angle, (..., 88) rad, clipped to its range, from the moving keys'."""
        angle = self.of_all_keys(np.maximum(angle, self.key_min_angle))
        # For so few numbers three times as fast as np.clip, or as scalar bounds.
        return np.minimum(angle, self.key_max_angle)

    def sounding_at(self, angles: Iterable[bytes]) -> BoolArray:
        """Find the keys that sound at angles of the moving keys (float64, rad), (n, 88) bool."""
        return self.angles_of(angles) >= self.key_sounding_angle

    def angles_of(self, angles: Iterable[bytes]) -> FloatArray:
        """Extend angles of the moving keys (float64, rad) to all keys, (n, 88)."""
        return self.of_all_keys(np.frombuffer(b"".join(angles)).reshape(-1, len(self.key_qpos)))

    def of_all_keys(self, angles: FloatArray) -> FloatArray:
        """Extend angles of the moving keys, (..., k) rad, to all keys, (..., 88)."""
        if angles.shape[-1] == NUM_KEYS:
            return angles
        everyone = np.zeros((*angles.shape[:-1], NUM_KEYS))
        everyone[..., self.moving_keys] = angles
        return everyone

    def fingertip_position(self, data: mujoco.MjData) -> FloatArray:
        """Return the world positions of the fingertips by label, (10, 3) m.

        The fingertips of an absent hand are ``FAR_AWAY``.
        """
        return self.by_finger(data.site_xpos.take(self.fingertip_site, axis=-2))

    def by_finger(self, tips: FloatArray) -> FloatArray:
        """Extend positions of the scene's fingers, (..., 5 h, 3) m, to all, (..., 10, 3)."""
        if tips.shape[-2] == NUM_FINGERS:
            return tips
        everyone = np.full((*tips.shape[:-2], NUM_FINGERS, 3), FAR_AWAY)
        everyone[..., self.fingers, :] = tips
        return everyone

    def press_point(self, data: mujoco.MjData, keys: IntArray) -> FloatArray:
        """Return the points where fingers should press the given keys, in the world, (n, 3) m."""
        geoms, offsets = self.press_geometry(keys)
        return np.asarray(data.geom_xpos[..., geoms, :] + offsets)

    def press_geometry(self, keys: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the geoms of keys, (...), and the offsets of their press points, (..., 3) m."""
        return self.key_geom[keys], self.key_press_offset[keys]

    def forearms_touch(self, data: mujoco.MjData) -> bool:
        """Check whether a geom of one forearm touches one of the other."""
        if len(self.forearm_geoms) < len(SIDES):
            return False
        (right, left), position = self.forearm_geoms, data.geom_xpos
        apart = position.item(right[0], 1) - position.item(left[0], 1)
        if abs(apart) > self.forearm_reach:
            return False  # faster than reading the contacts
        return any(
            (a in right and b in left) or (a in left and b in right)
            for a, b in data.contact.geom.tolist()
        )

    def copy(self) -> PianoScene:
        """Return the scene with copies of its model and thresholds, which may then be modified."""
        angles = self.key_sounding_angle.copy()
        return dataclasses.replace(self, model=copy.copy(self.model), key_sounding_angle=angles)


_KINDS = {"along": "forearm", "across": "forearm", "up": "forearm", "wrist": "wrist"}
_KINDS |= dict.fromkeys(("roll", "pitch", "yaw"), "elbow")


def kind_of(role: str) -> str:
    """Return the kind of a role: "finger", "wrist", "forearm" for sliders, "elbow" for hinges."""
    return _KINDS.get(role, "finger")


def tip_unit(kind: str) -> float:
    """Return the motion, rad or m, that moves a fingertip about as far as 1 rad of a finger."""
    return {"forearm": TIP_TRAVEL, "elbow": TIP_TRAVEL / FOREARM_TRAVEL}.get(kind, 1.0)
