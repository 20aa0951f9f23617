"""Position of a forearm that turns to the side, relative to the other forearm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco


@dataclass(frozen=True, eq=False)
class TurnedForearm:
    """Forearm that turns about an upright axis through its elbow.

    An inward turn moves its end towards the other forearm, but less than half as far as the
    fingertips. So the hands can be nearer to each other than straight forearms allow.
    """

    actuator: int
    """Index of the turn's actuator in the hand."""
    axis: float
    """1 if the axis points up, -1 if down."""
    sign: int
    """1 for the right hand, -1 for the left hand."""
    points: FloatArray
    """(2, k) corners of its geoms, along and across the keys from its elbow, m."""

    @classmethod
    def of(cls, model: mujoco.MjModel, joint: int, actuator: int, sign: int) -> TurnedForearm:
        """Make it for the forearm that a joint turns."""
        body = model.jnt_bodyid[joint]
        frame = rotation_matrix(model.body_quat[body])
        shapes = np.flatnonzero(model.geom_bodyid == body)
        corners = np.concatenate([_corners(model, int(shape)) for shape in shapes])
        return cls(
            actuator=actuator,
            axis=float(frame[2] @ model.jnt_axis[joint]),
            sign=sign,
            points=(corners @ frame.T)[:, :2].T.copy(),
        )

    def __call__(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the shift of its inner side across the keys, relative to a straight forearm.

        Args:
            positions: (s, n) actuator positions of the hand.

        Returns:
            (s,) shift, m; (s,) its derivative by the turn, m per rad.
        """
        along, across = self.points
        angle = self.axis * positions[:, self.actuator, None]
        sine, cosine = np.sin(angle), np.cos(angle)
        place = sine * along + cosine * across  # (s, k)
        inner = (self.sign * place).argmin(axis=1)
        rows = np.arange(len(place))
        straight = self.sign * (self.sign * across).min()
        slope = self.axis * (cosine[:, 0] * along[inner] - sine[:, 0] * across[inner])
        return place[rows, inner] - straight, slope


def _corners(model: mujoco.MjModel, shape: int) -> FloatArray:
    """Return the corners of a geom, or of its bounding box, in its body's frame, (k, 3) m."""
    if model.geom_type[shape] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[shape]
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        corners = model.mesh_vert[first : first + count].astype(float)
    else:
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        corners = model.geom_aabb[shape, :3] + signs * model.geom_aabb[shape, 3:]
    return np.asarray(corners @ rotation_matrix(model.geom_quat[shape]).T + model.geom_pos[shape])


def rotation_matrix(quaternion: Any) -> FloatArray:
    """Convert a quaternion (w first) to a rotation matrix, (3, 3)."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
