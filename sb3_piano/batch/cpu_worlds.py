"""Worlds on the threads of MuJoCo itself, number by number those of a single environment."""

from __future__ import annotations

import importlib
import warnings

import numpy as np
import torch

from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Count, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.engine import mujoco
from sb3_piano.threads import usable_cores

_BROKEN = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1)


class CpuWorlds(Worlds):
    """Worlds on ``mujoco.batch``, which works on threads below Python.

    Args:
        scene: What is simulated.
        count: How many worlds there are.
        n_substeps: Physics steps in a control step.
        n_threads: Threads to use, the calling one included; by default one for each usable core.

    Raises:
        ConfigError: If ``n_threads`` is not valid, or this MuJoCo has no batches.
    """

    def __init__(
        self, scene: PianoScene, count: int, n_substeps: int, n_threads: int | None = None
    ):
        super().__init__(scene, count, n_substeps, torch.device("cpu"))
        try:
            made = importlib.import_module("mujoco.batch").Batch  # in MuJoCo since 3.17
        except ImportError:
            raise ConfigError(
                f"MuJoCo {mujoco.__version__} has no mujoco.batch: expected 3.17 or later."
            ) from None
        n_threads = checked("n_threads", n_threads, Count | None) or usable_cores()
        self.n_threads = min(n_threads, count)
        """Threads that step the worlds."""
        self._stage = mujoco.mjtStage.mjSTAGE_VEL.value
        self._batch = made(scene.model, count, self.n_threads, persistent=True)
        for name in ("qpos", "qvel", "geom_xpos", "geom_xmat", "site_xpos"):
            setattr(self, name, self._view(name))
        self.actuator_force = self._view("actuator_force")
        self.actuator_velocity = self._view("actuator_velocity")
        self._ctrl = self._batch.bind("ctrl")
        self._warnings = self._batch.warning[:, _BROKEN, 1]  # how often
        self._data = mujoco.MjData(scene.model)
        self._between = np.zeros((count, n_substeps - 1, scene.model.nq))
        self._more_tensors()

    def _view(self, name: str) -> Tensor:
        with warnings.catch_warnings():  # what MuJoCo computes must not be written to
            warnings.simplefilter("ignore", UserWarning)
            return torch.from_numpy(self._batch.bind(name))

    def reset(self, mask: Tensor, sliders: Tensor | None = None) -> None:
        """Put worlds to rest; see :meth:`Worlds.reset`."""
        ids = np.flatnonzero(mask.numpy())
        self._batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if sliders is not None:
            self.qpos[ids[:, None], self.scene.slider_qpos] = sliders[ids, None]
        self._batch.forward(ids, stage=self._stage)
        self.lost[mask] = False

    def step(self, controls: Tensor) -> None:
        """Play a control step; see :meth:`Worlds.step`."""
        keys, moving = self.scene.key_slice, self.scene.moving_keys
        before = self._warnings.sum(axis=1)
        self._ctrl[:] = controls.numpy()
        if self.n_substeps > 1:
            out = {"qpos": self._between}
            self._batch.rollout(self.n_substeps - 1, record=("qpos",), out=out)
            self.key_angles[:, :-1, moving] = torch.from_numpy(self._between[:, :, keys])
        self._batch.step(nstep=1, stage=self._stage)
        self.key_angles[:, -1, moving] = self.qpos[:, keys]
        self.lost = torch.from_numpy(self._warnings.sum(axis=1) > before)

    def forearms_touch(self) -> Tensor:
        """Return in which worlds forearms touch; see :meth:`Worlds.forearms_touch`."""
        (right, *_), (left, *_) = self.scene.forearm_geoms
        apart = (self.geom_xpos[:, right, 1] - self.geom_xpos[:, left, 1]).abs()
        touching = apart <= self.scene.forearm_reach
        for world in touching.nonzero().flatten().tolist():  # only there contacts are asked for
            self._batch.get_data(world, self._data)
            touching[world] = self.scene.forearms_touch(self._data)
        return touching
