"""Positions of the keys, and of fingertips that press them, m.

World coordinates: x points from the keys' hinges to the player, y to the right, z up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.music.constants import KEY_IS_BLACK, THUMB
from sb3_piano.simulation import PianoScene

WHITE_X = (0.052, 0.042)
"""Press points of thumbs and of other fingers along white keys, m."""
_MIXED_X = (0.040, 0.026)  # the same while the hand plays black keys, too
_BLACK_X = (0.002, -0.002)  # the same on black keys


@dataclass(frozen=True, eq=False)
class KeyPlaces:
    """Geometry of the keys at rest, in the world."""

    y: FloatArray
    """(88,) centres across the keyboard, m."""
    top: FloatArray
    """(88,) height of the tops, m."""
    hinge: FloatArray
    """(88,) positions of the hinges along x, m."""
    max_angle: FloatArray
    """(88,) angle when fully down, rad."""
    holding_torque: FloatArray
    """(88,) torque of the springs when fully down, N m; rigid keys get a moving key's."""

    @classmethod
    def of(cls, scene: PianoScene) -> KeyPlaces:
        """Read the geometry from a scene."""
        data = mujoco.MjData(scene.model)
        mujoco.mj_kinematics(scene.model, data)
        centre, half = data.geom_xpos[scene.key_geom], scene.model.geom_size[scene.key_geom]
        # Keys are the first joints of their bodies, and have no other.
        joints = scene.model.body_jntadr[scene.model.geom_bodyid[scene.key_geom[scene.moving_keys]]]
        turn = scene.key_max_angle[scene.moving_keys] - scene.model.qpos_spring[scene.key_qpos]
        stiffness = np.asarray(scene.model.jnt_stiffness[joints]).reshape(len(joints), -1)[:, 0]
        torque = np.full(len(half), np.max(stiffness * turn))
        torque[scene.moving_keys] = stiffness * turn
        return cls(
            y=centre[:, 1].copy(),
            top=centre[:, 2] + half[:, 2],
            hinge=centre[:, 0] - half[:, 0],
            max_angle=scene.key_max_angle,
            holding_torque=torque,
        )

    def height(self, key: int, x: float, depth: float) -> float:
        """Compute the height of a key's top at ``x``, m; ``depth`` is a share of its travel."""
        drop = (x - self.hinge[key]) * np.tan(depth * self.max_angle[key])
        return float(self.top[key] - drop)


def press_x(key: int, finger: int, mixed: bool) -> float:
    """Return the press point of a finger, 0 (thumb) to 4, along a key, m.

    In a mixed passage the hand plays keys of the other colour at about the same time.
    """
    white = _MIXED_X if mixed else WHITE_X
    return (_BLACK_X if KEY_IS_BLACK[key] else white)[finger != THUMB]
