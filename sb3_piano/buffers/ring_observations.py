"""Observations of a replay buffer: stored once each, binary numbers as bits."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from stable_baselines3.common.preprocessing import get_obs_shape

from sb3_piano.arrays import Arrays
from sb3_piano.buffers.rows import IntArray, check_array
from sb3_piano.envs import ObservationSpace
from sb3_piano.exceptions import ConfigError, RunError

Bytes = npt.NDArray[np.uint8]
Observations = npt.NDArray[np.generic]


class ObservationPacking:
    """Convert observations of a space to bytes and back.

    First come the ordinary columns, as they are in memory, then one bit for each column of the
    blocks that the layout of an :class:`~sb3_piano.envs.ObservationSpace` calls binary. Any other
    space has ordinary columns only.

    Args:
        space: Space of the observations; not a ``Dict``.
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
        """Return observations as bytes, and a mask of those that the bytes hold exactly.

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
        """Invert :meth:`pack`: (n, width) uint8 become (n, ...) of the dtype."""
        flat = np.empty((len(packed), len(self.binary)), dtype=self.dtype)
        plain = np.ascontiguousarray(packed[:, : self._plain_width]).view(self.dtype)
        _set_columns(flat, self._plain, plain)
        bits = np.unpackbits(packed[:, self._plain_width :], axis=1, count=self._n_bits)
        _set_columns(flat, self._bits, bits)
        return flat.reshape(len(packed), *self.shape)

    def not_binary(self, observations: Observations) -> ConfigError:
        """Return the error for observations with a non-binary number, one per environment."""
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
    """Return slices of neighbouring true columns, which copy much faster than indices."""
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


Index = tuple[IntArray, IntArray] | tuple[IntArray, IntArray, slice]
"""(n,) rows and (n,) environments; Stable-Baselines3 sometimes adds a slice of all columns."""


class RingObservations:
    """The observations of a ring of rows, packed.

    This and :class:`RingNextObservations` stand in for a buffer's two arrays of observations, which
    Stable-Baselines3 uses in two ways only: ``array[row] = values`` when a transition is added, and
    ``array[rows, envs]`` when a batch is sampled.

    A *place* is one environment's part of a row: ``row * n_envs + env``.

    Args:
        packing: Conversion of observations to bytes.
        capacity: Number of rows.
        n_envs: Environments, thus observations, in a row.
    """

    def __init__(self, packing: ObservationPacking, capacity: int, n_envs: int):
        self.packing = packing
        self.capacity = capacity
        self.n_envs = n_envs
        self.n_places = capacity * n_envs
        self._packed: Bytes = np.zeros((self.n_places, packing.width), dtype=np.uint8)

    @property
    def nbytes(self) -> int:
        """Bytes in use."""
        return self._packed.nbytes

    def __setitem__(self, row: int, observations: Observations) -> None:
        """Store one row, (n_envs, ...); raise ConfigError for a non-binary number."""
        observations = observations.astype(self.packing.dtype, copy=False)
        packed, exact = self.packing.pack(observations)
        if not exact.all():
            raise self.packing.not_binary(observations)
        self._packed[row * self.n_envs : (row + 1) * self.n_envs] = packed

    def __getitem__(self, index: Index) -> Observations:
        """Return a copy of observations, (n, ...)."""
        return self.packing.unpack(self.packed_at(index[0] * self.n_envs + index[1]))

    def packed_at(self, places: IntArray) -> Bytes:
        """Return a copy of packed observations, (n, width) uint8, at (n,) places."""
        return self._packed.take(places, axis=0)

    def bytes_at(self, place: int) -> bytes:
        """Return one packed observation."""
        return self._packed[place].tobytes()

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return (n,) rows as arrays for :meth:`put_rows`."""
        packed = self._packed.reshape(self.capacity, self.n_envs, -1)[rows]
        return {"binary_columns": self.packing.binary, "packed_observations": packed}

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to arrays of :meth:`take_rows`.

        Raises:
            RunError: If they are rows of other observations.
        """
        binary = self.packing.binary
        if not np.array_equal(check_array(saved, "binary_columns", binary.shape, bool), binary):
            raise RunError("'binary_columns' differ from those of the observation space.")
        shape = (len(rows), self.n_envs, self.packing.width)
        packed = check_array(saved, "packed_observations", shape, np.uint8)
        self._packed.reshape(self.capacity, self.n_envs, -1)[rows] = packed


class RingNextObservations:
    """Next observations of a ring of rows; stores only those that the next row lacks.

    A transition's next observation usually is the observation of the next row. It has its own copy
    otherwise: at the end of an episode, at an interrupted episode, and in the two newest rows. As
    the number of copies is unknown, they are ``bytes`` in a dictionary by place, which also reuses
    the memory of deleted ones.

    ``VecNormalize`` gives back the last observation of an episode rounded and clipped: a 1 may
    become 0.9999999. Such copies are kept unpacked, recognised by their greater length.

    Args:
        observations: The observations of the same ring.
    """

    def __init__(self, observations: RingObservations):
        self._observations = observations
        self._own: dict[int, bytes] = {}

    @property
    def nbytes(self) -> int:
        """Bytes in use, including Python's dictionary and its objects."""
        sizes = sum(sys.getsizeof(item) for pair in self._own.items() for item in pair)
        return sys.getsizeof(self._own) + sizes

    def __setitem__(self, row: int, next_observations: Observations) -> None:
        """Store one row, (n_envs, ...); rows must come in order."""
        n_envs, packing = self._observations.n_envs, self._observations.packing
        next_observations = next_observations.astype(packing.dtype, copy=False)
        packed, exact = packing.pack(next_observations)
        # The row itself may yet be written again, if Ctrl-C keeps it from being added.
        self._let_go(row - 1)
        for env in range(n_envs):
            copy = packed[env] if exact[env] else next_observations[env]
            self._own[row * n_envs + env] = copy.tobytes()

    def __getitem__(self, index: Index) -> Observations:
        """Return a copy of next observations, (n, ...)."""
        n_envs, packing = self._observations.n_envs, self._observations.packing
        places = index[0] * n_envs + index[1]
        packed = self._observations.packed_at((places + n_envs) % self._observations.n_places)
        unpackable = {}
        for item, place in enumerate(places.tolist()):
            own = self._own.get(place)
            if own is None:
                continue
            if len(own) == packing.width:
                packed[item] = np.frombuffer(own, dtype=np.uint8)
            else:
                unpackable[item] = own
        observations = packing.unpack(packed)
        for item, own in unpackable.items():
            observations[item] = np.frombuffer(own, dtype=packing.dtype).reshape(packing.shape)
        return observations

    def clear(self) -> None:
        """Forget all rows."""
        self._own.clear()

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return the copies of (n,) rows as arrays for :meth:`put_rows`."""
        places = self._places(rows)
        at = [item for item, place in enumerate(places) if place in self._own]
        own = [self._own[places[item]] for item in at]
        return {
            "own_at": np.array(at, dtype=np.int64),
            "own_sizes": np.array([len(copy) for copy in own], dtype=np.int64),
            "own_bytes": np.frombuffer(b"".join(own), dtype=np.uint8),
        }

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set the copies of (n,) rows to arrays of :meth:`take_rows`."""
        count = len(saved.get("own_at", ()))
        at = check_array(saved, "own_at", (count,), np.int64)
        sizes = check_array(saved, "own_sizes", (count,), np.int64)
        data = check_array(saved, "own_bytes", (int(sizes.sum()),), np.uint8)
        places = self._places(rows)
        for place in places:
            self._own.pop(place, None)
        for item, copy in zip(at.tolist(), np.split(data, sizes.cumsum()[:-1]), strict=False):
            self._own[places[item]] = copy.tobytes()

    def _places(self, rows: IntArray) -> list[int]:
        n_envs = self._observations.n_envs
        return (rows[:, None] * n_envs + np.arange(n_envs)).reshape(-1).tolist()

    def _let_go(self, row: int) -> None:
        """Drop the copies of the row before ``row`` that equal this row's observations."""
        n_envs, n_places = self._observations.n_envs, self._observations.n_places
        for env in range(n_envs):
            place = (row * n_envs + env) % n_places
            before = (place - n_envs) % n_places
            if self._own.get(before) == self._observations.bytes_at(place):
                del self._own[before]
