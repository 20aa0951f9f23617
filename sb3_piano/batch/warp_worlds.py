"""Worlds on a GPU with MuJoCo Warp, in single precision."""

import warnings
from collections.abc import Sequence
from typing import Any

import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp

from sb3_piano.batch.worlds import Tensor, Worlds
from sb3_piano.engine import mujoco
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.settings import Count, checked
from sb3_piano.simulation import PianoScene

wp.config.log_level = wp.LOG_WARNING

# Most constraints observed in a world, and a margin; see docs/batch.md.
_CONSTRAINTS = 192
_OF_REFERENCE = 288  # each key rests on its limit
_CONTACTS = 48  # on average over all worlds: one may have more
_CONVEX = 24  # pairs for the general collision routine, likewise
_NONZERO = 2048  # of the constraints' Jacobian: three times the observed mean

_FASTEST = 1e3
"""Joint speed, rad/s or m/s, above which a world's physics counts as broken."""

_BUFFERS = {
    "n_constraints": mjw.OverflowType.NEFC,
    "n_nonzero": mjw.OverflowType.NJMAX_NNZ,
    "n_contacts": mjw.OverflowType.BROADPHASE | mjw.OverflowType.NARROWPHASE,
    "n_convex": mjw.OverflowType.CCD,
}


class BufferWarning(UserWarning):
    """Warning: a buffer of MuJoCo Warp was too small, and some worlds lack forces."""


class WarpWorlds(Worlds):
    """Worlds of MuJoCo Warp; on a CUDA device a control step is one captured graph.

    Args:
        scene: Scene to simulate.
        count: Number of worlds.
        n_substeps: Physics steps in a control step.
        device: "cuda", "cuda:1" or "cpu" (only to try it: far slower than ``CpuWorlds``); by
            default CUDA if available.
        n_contacts: Size of the contact buffer for each world, on average.
        n_constraints: Size of the constraint buffer for each world.
        n_nonzero: Non-zero entries in the constraints' Jacobian, likewise.
        n_convex: Close pairs of cylinders and hulls, likewise, on average.
        graph: Whether to capture a graph, if the device can.
        varied: Names of the model's fields of which each world has its own; not masses, whose
            derived constants Warp would share.

    Raises:
        ConfigError: If an argument is not valid, the device does not exist, or its memory is too
            small for the worlds.
    """

    def __init__(
        self,
        scene: PianoScene,
        count: int,
        n_substeps: int,
        *,
        device: str | None = None,
        n_contacts: int = _CONTACTS,
        n_constraints: int | None = None,
        n_nonzero: int = _NONZERO,
        n_convex: int = _CONVEX,
        graph: bool = True,
        varied: Sequence[str] = (),
    ):
        super().__init__(scene, count, n_substeps, torch.device(_device(device)))
        if "body_mass" in varied:
            raise ConfigError(
                "Masses cannot differ between worlds of MuJoCo Warp: expected mass (1, 1), or "
                "backend='cpu'."
            )
        reference = bool(scene.model.opt.gravity.any())
        rows = _OF_REFERENCE if reference else _CONSTRAINTS
        if reference:
            n_nonzero = max(n_nonzero, 2 * _NONZERO)
        data = mujoco.MjData(scene.model)
        mujoco.mj_forward(scene.model, data)
        self._on = wp.device_from_torch(self.device)
        try:
            with wp.ScopedDevice(self._on):
                self._m = mjw.put_model(scene.model, dict.fromkeys(varied, count))
                self.fields = {name: self._field(name) for name in varied}
                self._d = mjw.put_data(
                    scene.model,
                    data,
                    nworld=count,
                    nconmax=checked("n_contacts", n_contacts, Count),
                    njmax=checked("n_constraints", n_constraints or rows, Count),
                    njmax_nnz=checked("n_nonzero", n_nonzero, Count),
                    nccdmax=checked("n_convex", n_convex, Count),
                )
                self._take()
        except RuntimeError as error:
            if "alloc" not in str(error) and "memory" not in str(error):
                raise
            raise ConfigError(
                f"{count} worlds do not fit into the memory of {self.device} ({one_line(error)}): "
                "expected fewer worlds, or smaller buffers."
            ) from error
        self._graphs: dict[str, Any] | None = {} if graph and self._on.is_cuda else None
        self._warm_up()

    def _field(self, name: str) -> Tensor:
        """View a field of the model in MuJoCo's shape, (N, ...)."""
        shape = getattr(self.scene.model, name).shape
        tensor: Tensor = wp.to_torch(getattr(self._m, name))
        return tensor.view(self.count, *tensor.shape[1 : 1 + len(shape)])

    def _take(self) -> None:
        """View Warp's arrays as tensors, and allocate the other tensors."""
        d, count, tensor = self._d, self.count, wp.to_torch
        self.qpos, self.qvel, self._ctrl = tensor(d.qpos), tensor(d.qvel), tensor(d.ctrl)
        self.geom_xpos = tensor(d.geom_xpos).view(count, -1, 3)
        self._geom_xmat = tensor(d.geom_xmat).view(count, -1, 9)
        self.site_xpos = tensor(d.site_xpos).view(count, -1, 3)
        self.actuator_force = tensor(d.actuator_force)
        self.actuator_velocity = tensor(d.actuator_velocity)
        self._angles = self.qpos.new_zeros(count, self.n_substeps, NUM_KEYS)
        self._mask = torch.zeros(count, dtype=torch.bool, device=self.device)
        self._sliders = self.qpos.new_zeros(count)
        self._touching = torch.zeros(count, dtype=torch.int32, device=self.device)
        self._overflow = tensor(d.overflow)
        self._told = 0
        side = np.zeros(self.scene.model.ngeom, dtype=np.int32)
        for number, geoms in enumerate(self.scene.forearm_geoms, start=1):
            side[geoms] = number
        self._side = wp.array(side, dtype=int)
        self._slider_qpos = wp.array(self.scene.slider_qpos.astype(np.int32), dtype=int)

    def update_constants(self, mask: Tensor) -> None:
        """Do nothing: no field that may differ has constants of its own."""

    def reset(self, mask: Tensor, sliders: Tensor | None = None) -> None:
        """Reset worlds to rest; see :meth:`Worlds.reset`."""
        self._mask.copy_(mask)
        self._sliders.zero_() if sliders is None else self._sliders.copy_(sliders)
        self._run("reset")
        self.lost = self.lost & ~self._mask

    def set_state(self, qpos: Tensor, qvel: Tensor) -> None:
        """Set the state; see :meth:`Worlds.set_state`."""
        self.qpos.copy_(qpos)
        self.qvel.copy_(qvel)
        with wp.ScopedDevice(self._on):
            mjw.step1(self._m, self._d)
            self._note_contacts()

    def step(self, controls: Tensor) -> None:
        """Simulate a control step; see :meth:`Worlds.step`."""
        self._ctrl.copy_(controls)
        self._run("step")
        broken = ~torch.isfinite(self.qpos).all(1) | ~(self.qvel.abs() < _FASTEST).all(1)
        self.lost = broken
        self._tell_overflow()

    @property
    def geom_xmat(self) -> Tensor:
        """(N, ngeom, 9) axes of all shapes."""
        return self._geom_xmat

    def key_angles(self) -> Tensor:
        """Return the angles of keys; see :meth:`Worlds.key_angles`."""
        return self._angles

    def angles_within(self, worlds: Tensor, keys: Tensor) -> Tensor:
        """Return angles of some keys; see :meth:`Worlds.angles_within`."""
        return self._angles[worlds, :-1, keys]

    def forearms_touch(self) -> Tensor:
        """Return the worlds whose forearms touch; see :meth:`Worlds.forearms_touch`."""
        return self._touching > 0

    @property
    def memory(self) -> int:
        """Used memory of the device, bytes; 0 on a CPU."""
        if not self._on.is_cuda:
            return 0
        return int(self._on.total_memory - self._on.free_memory)

    def _run(self, name: str) -> None:
        """Launch all kernels of a reset or step; on a CUDA device as one graph.

        Warp's stream and torch's default stream wait for each other.
        """
        launch = self._launch_reset if name == "reset" else self._launch_step
        with wp.ScopedDevice(self._on):
            if self._graphs is None:
                launch()
                return
            if name not in self._graphs:
                with wp.ScopedCapture() as capture:
                    launch()
                self._graphs[name] = capture.graph
            wp.capture_launch(self._graphs[name])

    def _warm_up(self) -> None:
        """Compile and load all kernels, as a captured graph contains only loaded ones."""
        self._mask.fill_(True)
        if self._on.is_cuda:
            torch.cuda.synchronize(self.device)
        with wp.ScopedDevice(self._on):
            self._launch_reset()
            self._launch_step()
            self._launch_reset()
            wp.synchronize_device()

    def _launch_step(self) -> None:
        m, d = self._m, self._d
        mjw.step2(m, d)
        self._note_keys(0)
        for substep in range(1, self.n_substeps):
            mjw.step(m, d)
            self._note_keys(substep)
        mjw.step1(m, d)
        self._note_contacts()

    def _launch_reset(self) -> None:
        m, d = self._m, self._d
        mask = wp.from_torch(self._mask)
        mjw.reset_data(m, d, mask)
        sliders = wp.from_torch(self._sliders)
        if self.scene.sides:
            dim = (self.count, len(self._slider_qpos))
            wp.launch(_place, dim, [mask, self._slider_qpos, sliders], [d.qpos])
        mjw.step1(m, d)  # in all worlds: positions of the others are unchanged
        self._note_contacts()

    def _note_keys(self, substep: int) -> None:
        keys, moving = self.scene.key_slice, self.scene.moving_keys
        wp.launch(
            _note_key,
            (self.count, keys.stop - keys.start),
            [self._d.qpos, keys.start, moving.start, substep],
            [wp.from_torch(self._angles)],
        )

    def _note_contacts(self) -> None:
        touching, d = wp.from_torch(self._touching), self._d
        touching.zero_()
        wp.launch(
            _note_contact,
            d.naconmax,
            [d.nacon, d.contact.geom, d.contact.worldid, self._side],
            [touching],
        )

    def _tell_overflow(self) -> None:
        bits = int(sum(bit for bit in _BUFFERS.values()))
        full = (self._overflow & bits) != 0
        count = int(full.sum())
        if not count:
            return
        seen = [name for name, bit in _BUFFERS.items() if ((self._overflow & int(bit)) != 0).any()]
        self._overflow.zero_()
        self._told += count
        if self._told.bit_count() == 1 or self._told == count:  # at first, then ever more rarely
            warnings.warn(
                f"Forces were left out in {count} of {self.count} worlds, as buffers were too "
                f"small: expected larger {' and '.join(seen)} in physics_options.",
                BufferWarning,
                stacklevel=2,
            )


def _device(device: str | None) -> str:
    wp.init()
    there = torch.cuda.is_available() and wp.is_cuda_available()
    device = device or ("cuda" if there else "cpu")
    if device != "cpu" and not there:
        raise ConfigError(
            f"device is {device!r}, but there is no CUDA device: expected one, or backend='cpu'."
        )
    return f"cuda:{torch.cuda.current_device()}" if device == "cuda" else device


@wp.kernel
def _place(
    mask: wp.array[bool],
    address: wp.array[int],
    place: wp.array[float],
    qpos: wp.array2d[float],
) -> None:
    world, slider = wp.tid()
    if mask[world]:
        qpos[world, address[slider]] = place[world]


@wp.kernel
def _note_key(
    qpos: wp.array2d[float],
    first: int,
    key: int,
    substep: int,
    angles: wp.array3d[float],
) -> None:
    world, number = wp.tid()
    angles[world, substep, key + number] = qpos[world, first + number]


@wp.kernel
def _note_contact(
    count: wp.array[int],
    geom: wp.array[wp.vec2i],
    world: wp.array[int],
    side: wp.array[int],
    touching: wp.array[int],
) -> None:
    contact = wp.tid()
    if contact < count[0]:
        pair = geom[contact]
        if side[pair[0]] * side[pair[1]] == 2:
            touching[world[contact]] = 1
