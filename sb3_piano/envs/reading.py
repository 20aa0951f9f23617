"""The state of the simulation after a control step, read once for all who need it."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]


class Reading(NamedTuple):
    """State of hands and keys. The arrays that are views change with the simulation."""

    data: mujoco.MjData
    """The simulation itself."""
    qpos: FloatArray
    """(nq,) joint positions, rad or m; a view."""
    key_state: FloatArray
    """(88,) key angle over its largest angle, in [0, 1]."""
    sounding: npt.NDArray[np.bool_]
    """(88,) keys that sound."""
    fingertips: FloatArray
    """(10, 3) positions of the fingertips in the world, m."""
    pedal: float
    """The pedal's command in [0, 1]."""

    @classmethod
    def of(cls, scene: PianoScene, data: mujoco.MjData, pedal: float) -> Reading:
        """Read a simulation."""
        qpos = data.qpos
        angle = scene.key_angle_at(qpos)
        return cls(
            data,
            qpos,
            angle / scene.key_max_angle,
            angle >= scene.key_sounding_angle,
            scene.fingertip_position(data),
            pedal,
        )
