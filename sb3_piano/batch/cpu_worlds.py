"""Worlds on MuJoCo's own threads, numerically equal to single environments."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Sequence

import numpy as np
import torch

from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.engine import Batch, mujoco
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.settings import Count, checked
from sb3_piano.simulation import PianoScene
from sb3_piano.simulation.compiling import assemble_scene, attach_parts, scene_parts
from sb3_piano.simulation.simulation import INSTABILITIES
from sb3_piano.threads import usable_cores


class CpuWorlds(Worlds):
    """Worlds of ``mujoco.batch``, which steps them on threads outside Python.

    Args:
        scene: Scene to simulate.
        count: Number of worlds.
        n_substeps: Physics steps in a control step.
        n_threads: Threads, including the calling one; by default one for each usable core.
        varied: Names of the model's fields of which each world has its own.

    Raises:
        ConfigError: If ``n_threads`` is not valid.
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
        n_threads = checked("n_threads", n_threads, Count | None) or usable_cores()
        self.n_threads = min(n_threads, count)
        """Threads that step the worlds."""
        self._stage = mujoco.mjtStage.mjSTAGE_VEL.value
        model = _with_noted_keys(scene, n_substeps)
        self._batch = Batch(model, count, self.n_threads, persistent=True)
        self.fields = {name: torch.from_numpy(self._batch.expand(name)) for name in varied}
        self.qpos, self.qvel = self._view("qpos"), self._view("qvel")
        self.geom_xpos, self.site_xpos = self._view("geom_xpos"), self._view("site_xpos")
        self.actuator_force = self._view("actuator_force")
        self.actuator_velocity = self._view("actuator_velocity")
        self._ctrl = self._batch.bind("ctrl")
        self._warnings = self._batch.warning[:, INSTABILITIES, 1]  # counts
        self._warned, self._none = self._warnings.sum(axis=1), self.lost
        # For each key: two numbers, the sample times, the angles at these.
        history = torch.from_numpy(self._batch.bind("history"))
        self._noted = history.view(count, len(scene.key_qpos), -1)[:, :, -n_substeps:][:, :, 1:]
        if len(scene.sides) > 1:
            self._take_forearms()

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
        self._warned = self._warnings.sum(axis=1)
        self.lost = self.lost & ~mask

    def set_state(self, qpos: Tensor, qvel: Tensor) -> None:
        """Set the state; see :meth:`Worlds.set_state`."""
        self.qpos[:], self.qvel[:] = qpos, qvel
        self._batch.forward(stage=self._stage)

    def step(self, controls: Tensor) -> None:
        """Play a control step; see :meth:`Worlds.step`."""
        self._ctrl[:] = controls.numpy()
        self._batch.step(nstep=self.n_substeps, stage=self._stage)
        before, self._warned = self._warned, self._warnings.sum(axis=1)
        self.may_be_lost = not np.array_equal(before, self._warned)
        self.lost = torch.from_numpy(self._warned > before) if self.may_be_lost else self._none

    @functools.cached_property
    def geom_xmat(self) -> Tensor:
        """(N, ngeom, 9) axes of all shapes, copied in each step after the first access."""
        return self._view("geom_xmat").view(self.count, -1, 9)

    def contacts(self, world: int) -> list[tuple[str, str]]:
        """Return the kinds of shapes of each contact in a world, such as ("BOX", "CAPSULE")."""
        data = self._batch.get_data(world)
        kinds = self.scene.model.geom_type[data.contact.geom]
        names = [[mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_") for kind in p] for p in kinds]
        return [(min(pair), max(pair)) for pair in names]

    def key_angles(self) -> Tensor:
        """Return the angles of keys; see :meth:`Worlds.key_angles`."""
        first, last = self.scene.moving_keys.start, self.scene.moving_keys.stop
        now = self.qpos[:, self.scene.key_slice]
        angles = torch.cat([self._noted, now[..., None]], -1).transpose(1, 2)
        rigid = (first, NUM_KEYS - last)
        return torch.nn.functional.pad(angles, rigid) if any(rigid) else angles

    def angles_within(self, worlds: Tensor, keys: Tensor) -> Tensor:
        """Return angles of some keys; see :meth:`Worlds.angles_within`."""
        return self._noted[worlds, keys - self.scene.moving_keys.start]

    def forearms_touch(self) -> Tensor:
        """Return in which worlds forearms touch; see :meth:`Worlds.forearms_touch`."""
        if len(self.scene.sides) < 2:
            return self._none
        places = self._places[:, self._first_forearms, 1]
        near = np.abs(places[:, 0] - places[:, 1]) <= self.scene.forearm_reach
        if not near.any():
            return self._none
        ids = np.flatnonzero(near)  # only these can touch
        self._arm_qpos[ids] = self._all_qpos[ids[:, None], self._arm_joints]
        self._arms.forward(ids, stage=mujoco.mjtStage.mjSTAGE_POS.value)
        return torch.from_numpy(near & (self._arm_contacts > 0))

    def _take_forearms(self) -> None:
        """Make worlds of both forearms alone, as the contacts of a batch cannot be read.

        Their contacts are the same: the shapes, their places and the routine are.
        """
        model = _forearms(self.scene)
        self._arms = Batch(model, self.count, self.n_threads)
        self._arm_qpos, self._arm_contacts = self._arms.bind("qpos"), self._arms.bind("ncon")
        names = [model.joint(joint).name for joint in range(model.njnt)]
        joints = [self.scene.model.joint(name).qposadr[0] for name in names]
        self._arm_joints = np.array(joints, dtype=np.intp)
        self._all_qpos, self._places = self._batch.bind("qpos"), self._batch.bind("geom_xpos")
        self._first_forearms = [geoms[0] for geoms in self.scene.forearm_geoms]


def _forearms(scene: PianoScene) -> mujoco.MjModel:
    """Return a model of both forearms without fingers and keyboard."""
    world, _, *hands = scene_parts(**scene.options)
    for hand in hands:
        for element in (*hand.actuators, *hand.tendons, *hand.excludes, *hand.sensors):
            hand.delete(element)
        short, name = scene.hand.short, scene.hand.forearm.body
        forearm = next(body for body in hand.bodies if short(body.name) == name)
        for body in forearm.bodies:
            hand.delete(body)
    return attach_parts([world, *hands]).compile()


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
