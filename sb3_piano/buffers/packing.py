"""Observations as rows of bytes, in which a number that is only ever 0 or 1 takes one bit."""

from __future__ import annotations

from typing import cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from stable_baselines3.common.preprocessing import get_obs_shape

from sb3_piano.envs import ObservationSpace
from sb3_piano.exceptions import ConfigError

Bytes = npt.NDArray[np.uint8]
Observations = npt.NDArray[np.generic]


class ObservationPacking:
    """Turns observations of a space into bytes and back.

    First come the ordinary columns, as they are in memory, then one bit for each column of the
    blocks that the layout of an :class:`~sb3_piano.envs.ObservationSpace` calls binary. Any other
    space has ordinary columns only.

    Args:
        space: What the observations are like; not a ``Dict``.
    """

    def __init__(self, space: spaces.Space):
        self.shape = cast(tuple[int, ...], get_obs_shape(space))
        """Shape of one observation."""
        self.dtype = np.dtype(space.dtype)
        """Type of its numbers."""
        self._layout = space.layout if isinstance(space, ObservationSpace) else None
        self.binary = np.zeros(int(np.prod(self.shape)), dtype=bool)
        """(size,) bool, the columns that are kept as bits."""
        for block in () if self._layout is None else self._layout.values():
            self.binary[block.slice] = block.binary
        self._bits, self._plain = _runs(self.binary), _runs(~self.binary)
        self._n_bits = int(self.binary.sum())
        self._plain_width = int((~self.binary).sum()) * self.dtype.itemsize
        self.width = self._plain_width + (self._n_bits + 7) // 8
        """Bytes of one packed observation."""

    def pack(self, observations: Observations) -> tuple[Bytes, npt.NDArray[np.bool_]]:
        """Return observations as bytes, and which of them these bytes hold exactly.

        Args:
            observations: (n, ...) of the space's dtype.

        Returns:
            (n, width) uint8; and (n,) bool, false where a binary column is not 0 or 1, so that the
            bytes are of no use. -0.0 counts as 0.
        """
        flat = observations.reshape(len(observations), -1)
        values = _columns(flat, self._bits)
        ones = values == 1
        packed = np.empty((len(flat), self.width), dtype=np.uint8)
        packed[:, : self._plain_width] = _columns(flat, self._plain).view(np.uint8)
        packed[:, self._plain_width :] = np.packbits(ones, axis=1)
        return packed, np.count_nonzero(ones, axis=1) == np.count_nonzero(values, axis=1)

    def unpack(self, packed: Bytes) -> Observations:
        """Return what :meth:`pack` packed: (n, width) uint8 become (n, ...) of the dtype."""
        flat = np.empty((len(packed), len(self.binary)), dtype=self.dtype)
        plain = np.ascontiguousarray(packed[:, : self._plain_width]).view(self.dtype)
        _set_columns(flat, self._plain, plain)
        bits = np.unpackbits(packed[:, self._plain_width :], axis=1, count=self._n_bits)
        _set_columns(flat, self._bits, bits)
        return flat.reshape(len(packed), *self.shape)

    def not_binary(self, observations: Observations) -> ConfigError:
        """Return the error for observations, one per environment, that cannot be packed."""
        flat = observations.reshape(len(observations), -1)
        env, column = np.argwhere(self.binary & (flat != 0) & (flat != 1))[0]
        blocks = () if self._layout is None else self._layout.values()
        name = next(b.name for b in blocks if b.slice.start <= column < b.slice.stop)
        return ConfigError(
            f"Observation column {column} (in block '{name}') of environment {env} is "
            f"{flat[env, column]}: expected 0 or 1, since the layout of the observation space "
            "calls the block binary. A wrapper that changes such numbers has to declare an "
            "ordinary Box as its observation space."
        )


def _runs(columns: npt.NDArray[np.bool_]) -> tuple[slice, ...]:
    """Return the stretches of neighbouring true columns; slices copy much faster than indices."""
    edges = np.flatnonzero(np.diff(columns, prepend=False, append=False))
    return tuple(slice(int(a), int(b)) for a, b in edges.reshape(-1, 2))


def _columns(flat: Observations, runs: tuple[slice, ...]) -> Observations:
    nothing = flat[:, :0]  # there may be no run at all
    return np.concatenate([nothing, *(flat[:, run] for run in runs)], axis=1)


def _set_columns(flat: Observations, runs: tuple[slice, ...], values: Observations) -> None:
    start = 0
    for run in runs:
        stop = start + run.stop - run.start
        flat[:, run] = values[:, start:stop]
        start = stop
