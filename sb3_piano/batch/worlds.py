"""Interface of a physics engine that steps many worlds of one scene at once."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from sb3_piano.simulation import PianoScene

Tensor = torch.Tensor


class Worlds(ABC):
    """N worlds of one scene, with tensors whose first axis is the world.

    After :meth:`reset` and :meth:`step` all tensors show the present state, except the forces:
    these are from the last physics step, as in :class:`~sb3_piano.simulation.Simulation`.
    """

    qpos: Tensor
    """(N, nq) joint positions, rad or m."""
    qvel: Tensor
    """(N, nv) joint velocities."""
    geom_xpos: Tensor
    """(N, ngeom, 3) positions of all shapes, m."""
    site_xpos: Tensor
    """(N, nsite, 3) positions of the fingertips, m."""
    actuator_force: Tensor
    """(N, nu) N or N m."""
    actuator_velocity: Tensor
    """(N, nu) m/s or rad/s."""

    def __init__(self, scene: PianoScene, count: int, n_substeps: int, device: torch.device):
        self.scene, self.count, self.n_substeps, self.device = scene, count, n_substeps, device
        self.lost = torch.zeros(count, dtype=torch.bool, device=device)
        """(N,) worlds whose physics broke down in the last control step."""
        self.may_be_lost = True
        """Whether any may have; a backend that knows without waiting says so."""

        self.fields: dict[str, Tensor] = {}
        """(N, ...) fields of MuJoCo's model of which each world has its own, by name."""

    @property
    def dtype(self) -> torch.dtype:
        """Number type of the physics."""
        return self.qpos.dtype

    @property
    @abstractmethod
    def geom_xmat(self) -> Tensor:
        """(N, ngeom, 9) axes of all shapes; if needed, access it before the first reset."""

    @abstractmethod
    def key_angles(self) -> Tensor:
        """Return the angles of all keys after each physics step of the last control step.

        Returns:
            (N, p, 88), rad; 0 for rigid keys.
        """

    @abstractmethod
    def angles_within(self, worlds: Tensor, keys: Tensor) -> Tensor:
        """Return angles of moving keys after all physics steps of a control step but the last.

        Args:
            worlds: (n,) indices of worlds.
            keys: (n,) a key in each of them.

        Returns:
            (n, p - 1), rad.
        """

    @abstractmethod
    def update_constants(self, mask: Tensor) -> None:
        """Compute what follows from changed ``fields`` in some worlds, before their reset."""

    @abstractmethod
    def reset(self, mask: Tensor, sliders: Tensor | None = None) -> None:
        """Reset worlds to rest.

        Args:
            mask: (N,) bool, worlds to reset; at least one.
            sliders: (N,) start of their hands along the keyboard, m; by default 0.
        """

    @abstractmethod
    def set_state(self, qpos: Tensor, qvel: Tensor) -> None:
        """Set positions, (N, nq), and velocities, (N, nv), of all worlds."""

    @abstractmethod
    def step(self, controls: Tensor) -> None:
        """Simulate a control step in all worlds, with (N, nu) actuator targets."""

    @abstractmethod
    def forearms_touch(self) -> Tensor:
        """Return the worlds where shapes of both forearms touch, (N,) bool."""
