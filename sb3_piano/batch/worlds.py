"""What a physics has to offer that steps many worlds of one scene at once."""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from sb3_piano.simulation import PianoScene

Tensor = torch.Tensor


class Worlds(ABC):
    """N worlds of one scene; what is seen of them are tensors, whose first axis is the world.

    After :meth:`reset` and :meth:`step` all of it is that of the present state but for the forces,
    which are those of the last physics step, as in :class:`~sb3_piano.simulation.Simulation`.
    """

    qpos: Tensor
    """(N, nq) joint positions, rad or m."""
    qvel: Tensor
    """(N, nv) their velocities."""
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

    @property
    def dtype(self) -> torch.dtype:
        """Type of the numbers of the physics."""
        return self.qpos.dtype

    @property
    @abstractmethod
    def geom_xmat(self) -> Tensor:
        """(N, ngeom, 9) axes of all shapes; asked for before the first reset if at all."""

    @abstractmethod
    def key_angles(self, worlds: Tensor | slice) -> Tensor:
        """Return the angles of keys after each physics step of the last control step.

        Args:
            worlds: n of the worlds.

        Returns:
            (n, p, 88), rad; 0 of those that are rigid.
        """

    @abstractmethod
    def reset(self, mask: Tensor, sliders: Tensor | None = None) -> None:
        """Put worlds to rest.

        Args:
            mask: (N,) bool, those worlds; at least one.
            sliders: (N,) where their hands begin along the keyboard, m; by default at 0.
        """

    @abstractmethod
    def step(self, controls: Tensor) -> None:
        """Play a control step in all worlds, whose actuators are told (N, nu) targets."""

    @abstractmethod
    def forearms_touch(self) -> Tensor:
        """Return in which worlds a shape of one forearm touches one of the other, (N,) bool."""
