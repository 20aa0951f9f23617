"""The physics of a control step."""

from __future__ import annotations

import mujoco
import numpy as np
import numpy.typing as npt

from sb3_piano.simulation import PianoScene

FloatArray = npt.NDArray[np.float64]

# Neighbours in MuJoCo's list of warnings: bad positions, velocities, accelerations.
_INSTABILITIES = slice(
    int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1
)


def advance(
    scene: PianoScene, data: mujoco.MjData, controls: FloatArray, key_angles: FloatArray
) -> bool:
    """Simulate a control step.

    The position and velocity stages of the last state must be done already (by the last call, or by
    ``mj_step1``), so that the first physics step is MuJoCo's second stage and the call ends with
    the first stage: fingertips and velocities are then those of the new state, at no extra cost.

    Args:
        scene: What is simulated.
        data: Its state, which is advanced.
        controls: (nu,) what the actuators are told.
        key_angles: (p, 88) is filled with the angle of each moving key after each of the p physics
            steps, rad; the columns of rigid keys are left as they are.

    Returns:
        Whether the physics remained stable.
    """
    model, angles = scene.model, key_angles[:, scene.moving_keys]  # a view
    data.ctrl[:] = controls
    keys = data.qpos[scene.key_slice]
    mujoco.mj_step2(model, data)
    angles[0] = keys
    for substep in range(1, len(angles)):
        mujoco.mj_step(model, data)
        angles[substep] = keys
    mujoco.mj_step1(model, data)
    # MuJoCo answers NaN and huge numbers with a warning and starts the simulation anew.
    return not np.count_nonzero(data.warning.number[_INSTABILITIES])
