"""What the compact replay buffers share: rings of observations in place of SB3's arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_piano.buffers.ring_observations import (
    ObservationPacking,
    RingNextObservations,
    RingObservations,
)
from sb3_piano.buffers.rows import ArrayRows, Arrays, IntArray
from sb3_piano.exceptions import ConfigError

NO_NUMBERS = spaces.Box(0.0, 1.0, (0,))
"""Space with which SB3 makes arrays that take no memory."""


def refuse_optimization(is_set: bool, name: str) -> None:
    """Refuse ``optimize_memory_usage`` for a buffer of some name.

    Raises:
        ConfigError: If it is set.
    """
    if is_set:
        raise ConfigError(
            f"optimize_memory_usage is true for a {name}: expected false. It stores each "
            "observation once in any case, and handles time limits too."
        )


class Rings(ReplayBuffer):
    """A ``ReplayBuffer`` whose observations are in rings, by name; a single array's name is ""."""

    _rings: dict[str, RingObservations]
    _next_rings: dict[str, RingNextObservations]

    @property
    def nbytes(self) -> int:
        """Bytes that the transitions take now; copies of next observations may come and go."""
        arrays = sum(array.nbytes for array in ArrayRows(self).arrays.values())
        arrays += sum(ring.nbytes for ring in self._rings.values())
        return arrays + sum(ring.nbytes for ring in self._next_rings.values())

    def reset(self) -> None:
        """Forget all transitions."""
        super().reset()
        for ring in self._next_rings.values():
            ring.clear()

    def to_torch(self, array: npt.NDArray[Any], copy: bool = True) -> torch.Tensor:
        """Return a tensor; of what was sampled no second copy is made, for it is one already."""
        del copy
        return super().to_torch(array, copy=False)

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return (n,) rows, up to the newest one, to be saved: see ``BufferRows``."""
        taken = ArrayRows(self).take_rows(rows)
        for name, ring in self._rings.items():
            found = {**ring.take_rows(rows), **self._next_rings[name].take_rows(rows)}
            taken.update({_prefix(name) + part: array for part, array in found.items()})
        return taken

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to what :meth:`take_rows` gave.

        Raises:
            RunError: If they are rows of another kind of buffer or observation.
        """
        for name, ring in self._rings.items():
            start = _prefix(name)
            own = {n.removeprefix(start): a for n, a in saved.items() if n.startswith(start)}
            ring.put_rows(rows, own)
            self._next_rings[name].put_rows(rows, own)
        ArrayRows(self).put_rows(rows, saved)

    def _make_rings(self, packings: Mapping[str, ObservationPacking]) -> None:
        self._rings = {
            name: RingObservations(packing, self.buffer_size, self.n_envs)
            for name, packing in packings.items()
        }
        self._next_rings = {n: RingNextObservations(ring) for n, ring in self._rings.items()}


def _prefix(name: str) -> str:
    return f"{name}." if name else ""
