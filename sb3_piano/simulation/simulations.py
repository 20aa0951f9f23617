"""Several simulations of a scene at once, on MuJoCo's own threads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.engine import Batch, mujoco
from sb3_piano.settings import Count, checked
from sb3_piano.simulation.scene import PianoScene
from sb3_piano.simulation.simulation import INSTABILITIES
from sb3_piano.threads import usable_cores


class Advanced(NamedTuple):
    """Result of a control step in m simulations."""

    stable: BoolArray
    """(m,) whether the physics of each remained stable."""
    key_angles: FloatArray | None
    """(m, p, k) angles of the moving keys after each physics step, if these are ``watched``."""


class Simulations:
    """N simulations of a scene, each of which advances exactly like a :class:`Simulation`.

    Each keeps the solver's warm start from step to step. Scenes read them as they read MuJoCo's
    data: ``scene.key_angle(simulations)`` is (N, 88).

    Args:
        scene: Scene to simulate.
        n_substeps: Physics steps of a control step.
        count: Number of simulations.
        n_threads: Threads, the calling one included; by default one for each usable core.

    Raises:
        ConfigError: If ``n_threads`` is not a whole number from 1 on.
    """

    def __init__(
        self, scene: PianoScene, n_substeps: int, count: int, n_threads: int | None = None
    ):
        self.scene, self.count, self._n_substeps = scene, count, n_substeps
        self._n_threads = checked("n_threads", n_threads, Count | None)
        threads = min(self._n_threads or usable_cores(), count)
        self._batch = Batch(scene.model, count, threads, persistent=True)
        self.state: FloatArray = self._batch.state
        """(N, s) MuJoCo's integration states; a view."""
        self.qpos: FloatArray = self._batch.bind("qpos")
        """(N, nq) joint positions, rad or m; a view."""
        self.geom_xpos: FloatArray = self._batch.bind("geom_xpos")
        """(N, ngeom, 3) positions of all geoms after a step that is not ``watched``, m; a view."""
        self.site_xpos: FloatArray = self._batch.bind("site_xpos")
        """(N, nsite, 3) positions of the fingertips likewise."""
        self._ctrl = self._batch.bind("ctrl")
        self._warnings = self._batch.warning[:, INSTABILITIES, 1]  # counts

    def __reduce__(self) -> tuple[type[Simulations], tuple[object, ...]]:
        # A copy begins anew, as every search does.
        return Simulations, (self.scene, self._n_substeps, self.count, self._n_threads)

    def begin(self, state: FloatArray, count: int) -> None:
        """Set the state of the first simulations; take over what has changed in the model."""
        self._batch.set_models(self.scene.model)
        self.state[:count] = state

    def advance(
        self, which: npt.NDArray[np.intp], controls: FloatArray, *, watched: bool = False
    ) -> Advanced:
        """Simulate a control step.

        Args:
            which: The m simulations to advance; the others do not change.
            controls: (m, nu) targets of the actuators of each.
            watched: Whether the angles of keys are recorded.
        """
        self._ctrl[which] = controls
        before, angles = self._warnings[which], None
        if watched:
            recorded = self._batch.rollout(self._n_substeps, record=("qpos",), ids=which)
            angles = recorded["qpos"][:, :, self.scene.key_slice]
        else:
            stage = mujoco.mjtStage.mjSTAGE_VEL.value
            self._batch.step(which, nstep=self._n_substeps, stage=stage)
        return Advanced((self._warnings[which] == before).all(axis=1), angles)
