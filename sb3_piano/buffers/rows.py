"""Rows of a replay buffer as arrays, for saving and restoring."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.buffers import DictReplayBuffer, ReplayBuffer

from sb3_piano.arrays import Arrays
from sb3_piano.exceptions import RunError

IntArray = npt.NDArray[np.integer[Any]]


@runtime_checkable
class BufferRows(Protocol):
    """Protocol of buffers whose rows can be saved and restored.

    Rows are taken in the order in which they were added, up to the newest one, and put back in that
    order too; they may come in several portions, of which a later one overwrites an earlier one.
    """

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return all arrays of (n,) rows, by name."""

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set (n,) rows to arrays of :meth:`take_rows`; raise RunError if they do not fit."""


class ArrayRows:
    """Rows of a buffer with numpy arrays of its capacity.

    Args:
        buffer: A ``ReplayBuffer`` or one derived from it; any such array of its own counts too.
    """

    def __init__(self, buffer: ReplayBuffer):
        self.arrays: Arrays = {
            name: value
            for name, value in vars(buffer).items()
            if isinstance(value, np.ndarray) and value.ndim and len(value) == buffer.buffer_size
        }
        """The buffer's own arrays, by name."""

    def take_rows(self, rows: IntArray) -> Arrays:
        """Return the rows of each array, without a copy if they are contiguous."""
        return {name: _take(array, rows) for name, array in self.arrays.items()}

    def put_rows(self, rows: IntArray, saved: Mapping[str, npt.NDArray[Any]]) -> None:
        """Set the rows of each array.

        Raises:
            RunError: If an array is missing or has another shape or type.
        """
        for name, array in self.arrays.items():
            array[rows] = check_array(saved, name, (len(rows), *array.shape[1:]), array.dtype)


def buffer_rows(buffer: ReplayBuffer) -> BufferRows:
    """Return the row access of a buffer: the buffer itself, or its arrays.

    Raises:
        RunError: If the buffer keeps its rows in something else.
    """
    if isinstance(buffer, BufferRows):
        return buffer
    arrays = ArrayRows(buffer)
    if isinstance(buffer, DictReplayBuffer) or buffer.buffer_size < 2 or not arrays.arrays:
        raise RunError(
            f"A {type(buffer).__name__} of {buffer.buffer_size} row(s) cannot be saved for "
            "resuming: expected two or more rows in numpy arrays, as in ReplayBuffer or "
            "NStepReplayBuffer; of dictionaries sb3_piano.buffers.CompactDictReplayBuffer."
        )
    return arrays


def check_array(
    saved: Mapping[str, npt.NDArray[Any]],
    name: str,
    shape: tuple[int, ...],
    dtype: npt.DTypeLike,
) -> npt.NDArray[Any]:
    """Return one of the saved arrays after checking its shape.

    Raises:
        RunError: If it is missing or has another shape or type.
    """
    array = saved.get(name)
    if array is None:
        raise RunError(f"'{name}' is missing among {sorted(saved)}.")
    if array.shape != shape or array.dtype != dtype:
        raise RunError(
            f"'{name}' is {array.dtype} {array.shape}: expected {np.dtype(dtype)} {shape}."
        )
    return array


def _take(array: npt.NDArray[Any], rows: IntArray) -> npt.NDArray[Any]:
    first, last = int(rows[0]), int(rows[-1])
    return array[first : last + 1] if last - first + 1 == len(rows) else array[rows]
