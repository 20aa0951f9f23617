"""Random minibatches from more data than memory holds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
import torch

Rows = tuple[npt.NDArray[np.float32], ...]
"""Arrays with one row for each sample."""

Batch = tuple[torch.Tensor, ...]

DEFAULT_BUFFER = 2_000_000
"""Rows held in memory: 2 GB for rows of 250 numbers."""


class ShuffledRows:
    """Rows of several parts; each part is read on demand.

    Data that fits into the buffer is read once and shuffled as a whole. Larger data is read by
    parts in random order, once an epoch. Rows are drawn from the buffer, which is refilled after
    half of it is drawn, so that it mixes rows of several parts. Memory is one and a half buffers
    and two parts, whatever the number of parts.

    Args:
        parts: Functions that read the arrays of each part.
        sizes: Rows of each.
        buffer: Largest number of rows in memory, but at least two minibatches of larger data.
    """

    def __init__(
        self, parts: Sequence[Callable[[], Rows]], sizes: Sequence[int], buffer: int
    ) -> None:
        self._parts, self._sizes, self._buffer = parts, sizes, buffer
        self._kept: Batch | None = None

    def __len__(self) -> int:
        return sum(self._sizes)

    def parts(self) -> Iterator[Rows]:
        """Yield the arrays of one part after the other."""
        return (read() for read in self._parts)

    def batches(self, size: int, random: torch.Generator) -> Iterator[Batch]:
        """Yield each row once, in minibatches; the last one may be smaller."""
        if len(self) > self._buffer:
            yield from self._streamed(size, random)
            return
        if self._kept is None:
            self._kept = self._whole()
        for rows in torch.randperm(len(self), generator=random).split(size):
            yield tuple(array[rows] for array in self._kept)

    def _whole(self) -> Batch:
        arrays: Batch = ()
        first = 0
        for rows, size in zip(self.parts(), self._sizes, strict=True):
            if not arrays:  # in one piece: there may be gigabytes of it
                arrays = tuple(_empty(len(self), array) for array in rows)
            _write(arrays, first, rows)
            first += size
        return arrays

    def _streamed(self, size: int, random: torch.Generator) -> Iterator[Batch]:
        capacity = max(self._buffer, 2 * size)
        held = 0
        buffer: Batch = ()
        for number in torch.randperm(len(self._parts), generator=random).tolist():
            rows = self._parts[number]()
            order = torch.randperm(self._sizes[number], generator=random).numpy()
            buffer = buffer or tuple(_empty(capacity, array) for array in rows)
            while len(order):
                chosen, order = np.split(order, [min(capacity - held, len(order))])
                _write(buffer, held, tuple(array[chosen] for array in rows))
                held += len(chosen)
                if held == capacity:
                    mixed = torch.randperm(held, generator=random)
                    drawn = held // 2 // size * size
                    yield from _drawn(buffer, mixed[:drawn], size)
                    held -= drawn
                    for array in buffer:
                        array[:held] = array[mixed[drawn:]]
        yield from _drawn(buffer, torch.randperm(held, generator=random), size)


def _empty(count: int, like: npt.NDArray[np.float32]) -> torch.Tensor:
    return torch.empty((count, *like.shape[1:]), dtype=torch.float32)


def _write(arrays: Batch, first: int, rows: Rows) -> None:
    for array, part in zip(arrays, rows, strict=True):
        array[first : first + len(part)] = torch.from_numpy(np.ascontiguousarray(part))


def _drawn(arrays: Batch, rows: torch.Tensor, size: int) -> Iterator[Batch]:
    for chosen in rows.split(size) if len(rows) else ():
        yield tuple(array[chosen] for array in arrays)
