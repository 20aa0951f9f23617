"""Disturbances in the units of the hands' actuators."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.simulation import PianoScene

METRES_PER_RADIAN = 0.05
"""Travel of a forearm, m, that counts as 1 rad of a joint: a twentieth, about what a finger
joint moves its tip."""

FloatArray = npt.NDArray[np.float64]


def disturbance_units(scene: PianoScene) -> FloatArray:
    """Return what a disturbance of 1 rad means for each actuator, (nu,): 1 rad, or 0.05 m."""
    return np.where(_slides(scene), METRES_PER_RADIAN, 1.0)


def disturbance_units_of_joints(scene: PianoScene) -> FloatArray:
    """Return the same for the joints of both hands, (n,), right hand first, sliders last in each.

    The order is that of ``scene.joint_qpos``.
    """
    model = scene.model
    slides = model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)
    slide_qpos = model.jnt_qposadr[slides]
    return np.where(np.isin(np.concatenate(scene.joint_qpos), slide_qpos), METRES_PER_RADIAN, 1.0)


def half_ranges(scene: PianoScene) -> FloatArray:
    """Return by how much an action's change of 1 moves each actuator's target, (nu,) rad or m."""
    return np.asarray((scene.ctrl_high - scene.ctrl_low) / 2)


def _slides(scene: PianoScene) -> npt.NDArray[np.bool_]:
    model = scene.model
    on_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    joint = np.where(on_joint, model.actuator_trnid[:, 0], 0)
    return on_joint & (model.jnt_type[joint] == int(mujoco.mjtJoint.mjJNT_SLIDE))
