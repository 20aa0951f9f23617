"""Simulation of a scene, control step by control step."""

from __future__ import annotations

from typing import Any

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.engine import mujoco
from sb3_piano.music.constants import NUM_FINGERS
from sb3_piano.simulation.scene import PianoScene

# Neighbours in MuJoCo's list of warnings: bad positions, velocities, accelerations.
INSTABILITIES = slice(
    int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1
)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Simulation:
    """Simulation of a scene: MuJoCo's data, stepped and read once per control step.

    After the physics, Python's code has left the processor's caches, so the number of different
    operations decides the time. Arrays of ``MjData`` are therefore looked up once, and small values
    are handled as plain numbers or bytes.
    """

    def __init__(self, scene: PianoScene, n_substeps: int):
        """Make the data of a scene at rest, with ``n_substeps`` physics steps per control step."""
        self.scene = scene
        self.data = mujoco.MjData(scene.model)
        self._n_substeps = n_substeps
        self.key_angles_before = b""
        """Angles of the moving keys before the last control step, rad."""
        self.key_angles: list[bytes] = []
        """Angles of the moving keys after each physics step of the last control step, rad; see
        :meth:`PianoScene.sounding_at`."""
        self._look()
        self.read()

    def _look(self) -> None:
        data = self.data
        self.qpos: FloatArray = data.qpos
        """(nq,) joint positions, rad or m; a view."""
        self.geom_xpos: FloatArray = data.geom_xpos
        """(ngeom, 3) positions of all geoms in the world, m; a view."""
        self.actuator_force: FloatArray = data.actuator_force
        """(nu,) forces of the actuators, N or N m; a view."""
        self.actuator_velocity: FloatArray = data.actuator_velocity
        """(nu,) velocities of the actuators, m/s or rad/s; a view."""
        self._ctrl = data.ctrl
        self._site_xpos = data.site_xpos
        self._keys = self.qpos[self.scene.key_slice]
        self._instabilities = data.warning.number[INSTABILITIES]
        offsets = self.scene.key_press_offset.tolist()
        self._press = list(zip(self.scene.key_geom.tolist(), offsets, strict=True))

    def __getstate__(self) -> dict[str, Any]:
        # A copied view would become an independent array.
        kept = ("scene", "data", "_n_substeps", "key_angles_before", "key_angles")
        return {name: self.__dict__[name] for name in kept}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._look()
        self.read()

    def advance(self, controls: FloatArray) -> bool:
        """Simulate a control step.

        The position and velocity stages of the last state must be done already, by the last call or
        by ``mj_step1``. The call begins with MuJoCo's second stage and ends with the first stage:
        fingertips and velocities are then those of the new state, at no extra cost.

        Args:
            controls: (nu,) targets of the actuators.

        Returns:
            Whether the physics remained stable.
        """
        model, data, keys = self.scene.model, self.data, self._keys
        self._ctrl[:] = controls
        self.key_angles_before = keys.tobytes()  # the fastest copy
        mujoco.mj_step2(model, data)
        angles = [keys.tobytes()]
        for _ in range(1, self._n_substeps):
            mujoco.mj_step(model, data)
            angles.append(keys.tobytes())
        mujoco.mj_step1(model, data)
        self.key_angles = angles
        # At NaN and huge numbers MuJoCo warns and resets the simulation.
        return not any(self._instabilities.tobytes())

    @property
    def state_size(self) -> int:
        """Size of the state from :meth:`get_state`."""
        return mujoco.mj_stateSize(self.scene.model, _STATE)

    def get_state(self) -> FloatArray:
        """Return MuJoCo's integration state, (state_size,)."""
        state = np.empty(self.state_size)
        mujoco.mj_getState(self.scene.model, self.data, state, _STATE)
        return state

    def set_state(self, state: FloatArray) -> None:
        """Restore and read a state. Control steps from it are exactly reproducible."""
        mujoco.mj_resetData(self.scene.model, self.data)  # warnings of an instability, too
        mujoco.mj_setState(self.scene.model, self.data, state, _STATE)
        mujoco.mj_step1(self.scene.model, self.data)
        self.read()

    def read(self) -> None:
        """Read the present state into the attributes below."""
        scene = self.scene
        angle = scene.clipped_key_angle(self._keys)
        self.key_state: FloatArray = angle / scene.key_max_angle
        """(88,) key angle over its largest angle, in [0, 1]."""
        self.sounding = (angle >= scene.key_sounding_angle).tobytes()
        """Keys that sound, one byte each, 1 or 0: fast to compare and store."""
        tips: FloatArray = self._site_xpos.take(scene.fingertip_site, axis=0)
        self.fingertips = tips if len(tips) == NUM_FINGERS else scene.by_finger(tips)
        """(10, 3) positions of the fingertips in the world, m; see :meth:`PianoScene.by_finger`."""

    def press_point(self, key: int) -> tuple[float, float, float]:
        """Return the point where a finger should press a key, as plain numbers, m."""
        geom, (dx, dy, dz) = self._press[key]
        x, y, z = self.geom_xpos[geom].tolist()
        return x + dx, y + dy, z + dz
