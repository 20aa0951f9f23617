"""Place of a forearm across the keys, also of one that turns to the side."""

from __future__ import annotations

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.hands.kinematics import HandKinematics, rotation_matrix
from sb3_piano.simulation import PianoScene


class Arm:
    """Place of a hand's forearm across the keys, from the positions of the hand's actuators.

    The place of a turned forearm is that of a straight one as near to the other forearm. An inward
    turn moves its end towards the other forearm, but less than half as far as the fingertips. So
    the hands can be nearer to each other than straight forearms allow.
    """

    def __init__(self, scene: PianoScene, kinematics: HandKinematics):
        """Take the forearm of a hand; it turns to the side about an upright axis, if at all."""
        self._hand, model = kinematics, scene.model
        self._yaw = kinematics.roles.index("yaw") if "yaw" in kinematics.roles else None
        if self._yaw is not None:
            joint = kinematics.joint_ids[kinematics.joint_of_actuator[:, self._yaw].argmax()]
            body = model.jnt_bodyid[joint]
            frame = rotation_matrix(model.body_quat[body])
            shapes = np.flatnonzero(model.geom_bodyid == body).tolist()
            corners = np.concatenate([_corners(model, shape) for shape in shapes])
            self._upwards = float(frame[2] @ model.jnt_axis[joint])
            """1 if the turn's axis points up, -1 if down."""
            self._corners = (corners @ frame.T)[:, :2].T.copy()
            """(2, k) corners of its geoms, along and across the keys from its elbow, m."""

    def place(self, positions: FloatArray) -> FloatArray:
        """Compute the place at (s, n) actuator positions, (s,) m."""
        place = self._hand.middle + self._hand.slope * positions[:, self._hand.along]
        return np.asarray(place if self._yaw is None else place + self._inwards(positions)[0])

    def slopes(self, positions: FloatArray) -> FloatArray:
        """Compute the derivatives of the place by the actuators, (s, n)."""
        slopes = np.zeros_like(positions)
        slopes[:, self._hand.along] = self._hand.slope
        if self._yaw is not None:
            slopes[:, self._yaw] = self._inwards(positions)[1]
        return slopes

    def _inwards(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the shift of its inner side across the keys, relative to a straight forearm.

        Returns:
            (s,) shift, m; (s,) its derivative by the turn, m per rad.
        """
        (along, across), sign = self._corners, self._hand.sign
        angle = self._upwards * positions[:, self._yaw, None]
        sine, cosine = np.sin(angle), np.cos(angle)
        place = sine * along + cosine * across  # (s, k)
        inner = (sign * place).argmin(axis=1)
        straight = sign * (sign * across).min()
        slope = self._upwards * (cosine[:, 0] * along[inner] - sine[:, 0] * across[inner])
        return place[np.arange(len(place)), inner] - straight, slope


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
