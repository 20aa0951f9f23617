"""The compact replay buffer of dictionaries, such as vectors with pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer

from sb3_piano.buffers.ring_observations import (
    ObservationPacking,
    RingNextObservations,
    RingObservations,
)
from sb3_piano.buffers.rows import ArrayRows, Arrays, IntArray
from sb3_piano.exceptions import ConfigError

_NO_NUMBERS = spaces.Box(0.0, 1.0, (0,))


class CompactDictReplayBuffer(DictReplayBuffer):
    """A ``DictReplayBuffer`` that holds each observation once and gives the same samples.

    What :class:`~sb3_piano.buffers.CompactReplayBuffer` does for one array it does for each of a
    ``Dict``: pictures take half the memory, the piano's vectors a tenth. Its arguments are those of
    ``DictReplayBuffer``.

    Raises:
        ConfigError: If the observation space is no ``Dict`` of plain arrays, or
            ``optimize_memory_usage`` is set.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Space,
        action_space: spaces.Space,
        device: torch.device | str = "auto",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        handle_timeout_termination: bool = True,
    ):
        if optimize_memory_usage:
            raise ConfigError(
                "optimize_memory_usage is true for a CompactDictReplayBuffer: expected false. It "
                "stores each observation once in any case, and handles time limits too."
            )
        if not isinstance(observation_space, spaces.Dict) or any(
            isinstance(part, spaces.Dict) for part in observation_space.values()
        ):
            raise ConfigError(
                f"A CompactDictReplayBuffer cannot hold observations of {observation_space}: "
                "expected a Dict of plain arrays. CompactReplayBuffer holds a single array."
            )
        # Without numbers in the observations, the arrays made for them take no memory.
        super().__init__(
            buffer_size,
            spaces.Dict(dict.fromkeys(observation_space, _NO_NUMBERS)),
            action_space,
            device,
            n_envs,
            handle_timeout_termination=handle_timeout_termination,
        )
        packings = {name: ObservationPacking(part) for name, part in observation_space.items()}
        self.observation_space = observation_space
        self.obs_shape = {name: packing.shape for name, packing in packings.items()}
        self._observations = {
            name: RingObservations(packing, self.buffer_size, n_envs)
            for name, packing in packings.items()
        }
        self._next_observations = {
            name: RingNextObservations(ring) for name, ring in self._observations.items()
        }
        # They can do all that SB3 asks of the arrays in these two dictionaries.
        self.observations = self._observations  # type: ignore[assignment]
        self.next_observations = self._next_observations  # type: ignore[assignment]

    @property
    def nbytes(self) -> int:
        """Bytes that the transitions take now; copies of next observations may come and go."""
        arrays = sum(array.nbytes for array in ArrayRows(self).arrays.values())
        arrays += sum(ring.nbytes for ring in self._observations.values())
        return arrays + sum(ring.nbytes for ring in self._next_observations.values())

    def reset(self) -> None:
        """Forget all transitions."""
        super().reset()
        for ring in self._next_observations.values():
            ring.clear()

    def to_torch(self, array: npt.NDArray[Any], copy: bool = True) -> torch.Tensor:
        """Return a tensor; of what was sampled no second copy is made, for it is one already."""
        del copy
        return super().to_torch(array, copy=False)

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return (n,) rows, up to the newest one, to be saved: see ``BufferRows``."""
        taken = ArrayRows(self).take_rows(rows)
        for name, ring in self._observations.items():
            found = {**ring.take_rows(rows), **self._next_observations[name].take_rows(rows)}
            taken.update({f"{name}.{part}": array for part, array in found.items()})
        return taken

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to what :meth:`take_rows` gave.

        Raises:
            RunError: If they are rows of another kind of buffer or observation.
        """
        for name, ring in self._observations.items():
            own = {
                part.removeprefix(f"{name}."): array
                for part, array in saved.items()
                if part.startswith(f"{name}.")
            }
            ring.put_rows(rows, own)
            self._next_observations[name].put_rows(rows, own)
        ArrayRows(self).put_rows(rows, saved)
