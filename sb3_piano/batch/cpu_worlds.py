"""Worlds on MuJoCo's own threads, numerically equal to single environments."""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Sequence

import numpy as np
import torch

from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.settings import Count, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.compiling import assemble_scene, scene_parts
from sb3_piano.threads import usable_cores

_BROKEN = slice(int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1)


class CpuWorlds(Worlds):
    """Worlds of ``mujoco.batch``, which steps them on threads outside Python.

    Args:
        scene: Scene to simulate.
        count: Number of worlds.
        n_substeps: Physics steps in a control step.
        n_threads: Threads, including the calling one; by default one for each usable core.
        varied: Names of the model's fields of which each world has its own.

    Raises:
        ConfigError: If ``n_threads`` is not valid, or this MuJoCo has no ``mujoco.batch``.
    """

    def __init__(
        self,
        scene: PianoScene,
        count: int,
        n_substeps: int,
        n_threads: int | None = None,
        varied: Sequence[str] = (),
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
        model = _with_noted_keys(scene, n_substeps)
        self._batch = made(model, count, self.n_threads, persistent=True)
        self.fields = {name: torch.from_numpy(self._batch.expand(name)) for name in varied}
        self.qpos, self.qvel = self._view("qpos"), self._view("qvel")
        self.geom_xpos, self.site_xpos = self._view("geom_xpos"), self._view("site_xpos")
        self.actuator_force = self._view("actuator_force")
        self.actuator_velocity = self._view("actuator_velocity")
        self._ctrl = self._batch.bind("ctrl")
        self._warnings = self._batch.warning[:, _BROKEN, 1]  # counts
        self._data = mujoco.MjData(model)
        # For each key: two numbers, the sample times, the angles at these.
        history = torch.from_numpy(self._batch.bind("history"))
        self._noted = history.view(count, len(scene.key_qpos), -1)[:, :, -n_substeps:]

    def _view(self, name: str) -> Tensor:
        with warnings.catch_warnings():  # the arrays of MuJoCo's results are read-only
            warnings.simplefilter("ignore", UserWarning)
            return torch.from_numpy(self._batch.bind(name))

    def update_constants(self, mask: Tensor) -> None:
        """Compute constants; see :meth:`Worlds.update_constants`."""
        if "body_mass" in self.fields:
            self._batch.set_const(np.flatnonzero(mask.numpy()))

    def reset(self, mask: Tensor, sliders: Tensor | None = None) -> None:
        """Put worlds to rest; see :meth:`Worlds.reset`."""
        ids = np.flatnonzero(mask.numpy())
        self._batch.reset(ids, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        if sliders is not None:
            self.qpos[ids[:, None], self.scene.slider_qpos] = sliders[ids, None]
        self._batch.forward(ids, stage=self._stage)
        self.lost[mask] = False

    def set_state(self, qpos: Tensor, qvel: Tensor) -> None:
        """Set the state; see :meth:`Worlds.set_state`."""
        self.qpos[:], self.qvel[:] = qpos, qvel
        self._batch.forward(stage=self._stage)

    def step(self, controls: Tensor) -> None:
        """Play a control step; see :meth:`Worlds.step`."""
        before = self._warnings.sum(axis=1)
        self._ctrl[:] = controls.numpy()
        self._batch.step(nstep=self.n_substeps, stage=self._stage)
        self.lost = torch.from_numpy(self._warnings.sum(axis=1) > before)

    @functools.cached_property
    def geom_xmat(self) -> Tensor:
        """(N, ngeom, 9) axes of all shapes, copied in each step after the first access."""
        return self._view("geom_xmat").view(self.count, -1, 9)

    def contacts(self, world: int) -> list[tuple[str, str]]:
        """Return the kinds of shapes of each contact in a world, such as ("BOX", "CAPSULE")."""
        self._batch.get_data(world, self._data)
        kinds = self.scene.model.geom_type[self._data.contact.geom]
        names = [[mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_") for kind in p] for p in kinds]
        return [(min(pair), max(pair)) for pair in names]

    def key_angles(self, worlds: Tensor | slice) -> Tensor:
        """Return the angles of keys; see :meth:`Worlds.key_angles`."""
        first, last = self.scene.moving_keys.start, self.scene.moving_keys.stop
        now = self.qpos[worlds, self.scene.key_slice]
        angles = torch.cat([self._noted[worlds, :, 1:], now[..., None]], -1).transpose(1, 2)
        rigid = (first, NUM_KEYS - last)
        return torch.nn.functional.pad(angles, rigid) if any(rigid) else angles

    def forearms_touch(self) -> Tensor:
        """Return in which worlds forearms touch; see :meth:`Worlds.forearms_touch`."""
        (right, *_), (left, *_) = self.scene.forearm_geoms
        apart = (self.geom_xpos[:, right, 1] - self.geom_xpos[:, left, 1]).abs()
        touching = apart <= self.scene.forearm_reach
        for world in touching.nonzero().flatten().tolist():  # only these can touch
            self._batch.get_data(world, self._data)
            touching[world] = self.scene.forearms_touch(self._data)
        return touching


def _with_noted_keys(scene: PianoScene, n_substeps: int) -> mujoco.MjModel:
    """Return the model of a scene with sensors for the keys' angles before each physics step.

    With them a control step is one call: two calls would compute all contacts once more.
    """
    parts = scene_parts(**scene.options)
    _, keyboard, *_ = parts
    for joint in sorted(keyboard.joints, key=lambda each: int(each.name.rsplit("_", 1)[1])):
        keyboard.add_sensor(
            name=f"angle_{joint.name}",
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=joint.name,
            nsample=n_substeps,
        )
    return assemble_scene(parts, scene.options).model
