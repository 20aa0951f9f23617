"""What stands in a replay buffer for its arrays of observations and of next observations.

Stable-Baselines3 uses these two arrays in two ways only: ``array[row] = values`` when a transition
is added, and ``array[rows, envs]`` when a batch is sampled. Both classes here offer just that.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.buffers.packing import Bytes, ObservationPacking, Observations
from sb3_piano.buffers.rows import Arrays, IntArray, check_array
from sb3_piano.exceptions import RunError

Index = tuple[IntArray, IntArray] | tuple[IntArray, IntArray, slice]
"""(n,) rows and (n,) environments; Stable-Baselines3 sometimes adds a slice of all columns."""


class RingObservations:
    """The observations of a ring of rows, packed.

    A *place* is one environment's part of a row: ``row * n_envs + env``.

    Args:
        packing: How an observation is turned into bytes.
        capacity: How many rows there are.
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
        """Store one row, (n_envs, ...); a ConfigError tells of a binary number that is none."""
        observations = observations.astype(self.packing.dtype, copy=False)
        packed, exact = self.packing.pack(observations)
        if not exact.all():
            raise self.packing.not_binary(observations)
        self._packed[row * self.n_envs : (row + 1) * self.n_envs] = packed

    def __getitem__(self, index: Index) -> Observations:
        """Return (n, ...) observations, a copy."""
        return self.packing.unpack(self.packed_at(index[0] * self.n_envs + index[1]))

    def packed_at(self, places: IntArray) -> Bytes:
        """Return (n, width) uint8, the observations at (n,) places, a copy."""
        return self._packed.take(places, axis=0)

    def bytes_at(self, place: int) -> bytes:
        """Return one packed observation."""
        return self._packed[place].tobytes()

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return (n,) rows as arrays that :meth:`put_rows` understands."""
        packed = self._packed.reshape(self.capacity, self.n_envs, -1)[rows]
        return {"binary_columns": self.packing.binary, "packed_observations": packed}

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to what :meth:`take_rows` gave.

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
    """The next observations of a ring of rows, of which only the unusual ones are stored.

    Mostly a transition's next observation is the observation of the row after it. It has a copy of
    its own where that is not so, at the end of an episode or where another one was begun instead,
    and in the two newest rows. How many copies there will be is not known, so they are kept as
    ``bytes`` in a dictionary by place, which also reuses the memory of those let go.

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
        """Bytes in use, with those that Python needs for the dictionary and its objects."""
        sizes = sum(sys.getsizeof(item) for pair in self._own.items() for item in pair)
        return sys.getsizeof(self._own) + sizes

    @property
    def n_copies(self) -> int:
        """How many next observations are stored."""
        return len(self._own)

    def __setitem__(self, row: int, next_observations: Observations) -> None:
        """Store one row, (n_envs, ...); rows are stored one after the other."""
        n_envs, packing = self._observations.n_envs, self._observations.packing
        next_observations = next_observations.astype(packing.dtype, copy=False)
        packed, exact = packing.pack(next_observations)
        # The row itself may yet be written again, if Ctrl-C keeps it from being added.
        self._let_go(row - 1)
        for env in range(n_envs):
            copy = packed[env] if exact[env] else next_observations[env]
            self._own[row * n_envs + env] = copy.tobytes()

    def __getitem__(self, index: Index) -> Observations:
        """Return (n, ...) next observations, a copy."""
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
        """Return the copies of (n,) rows as arrays that :meth:`put_rows` understands."""
        places = self._places(rows)
        at = [item for item, place in enumerate(places) if place in self._own]
        own = [self._own[places[item]] for item in at]
        return {
            "own_at": np.array(at, dtype=np.int64),
            "own_sizes": np.array([len(copy) for copy in own], dtype=np.int64),
            "own_bytes": np.frombuffer(b"".join(own), dtype=np.uint8),
        }

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set the copies of (n,) rows to what :meth:`take_rows` gave."""
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
