"""Read arrays from NumPy, safetensors and HDF5 files, with a limit on their size."""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import Arrays
from sb3_piano.exceptions import one_line
from sb3_piano.files import MOST_BYTES, check_file, read_file, read_member

_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_ARRAY_SUFFIX = ".npy"
_MOST_OF_HEADER = 2**20
"""Most bytes of the header of a safetensors file, which has some hundred for each tensor."""
_MOST_PACKED = 100
"""Largest ratio of the arrays' bytes to the size of an HDF5 file, which may be compressed."""
_ITEM_BYTES = 2**12
"""Least bytes that each item counts for, so that a group within itself comes to an end."""


def read_arrays(
    path: str | os.PathLike[str], names: Iterable[str] | None = None, most: int = MOST_BYTES
) -> Arrays:
    """Read arrays from a .npz file by name, all of them by default.

    Args:
        path: The file.
        names: Names of the arrays to read.
        most: Most bytes of the file, and of the arrays together.

    Raises:
        OSError: If it is no file or cannot be read.
        ValueError: If it is damaged, lacks an array, or exceeds the limit.
    """
    content, left, arrays = io.BytesIO(read_file(path, most)), most, Arrays()
    try:
        with zipfile.ZipFile(content) as archive:
            members = [name.removesuffix(_ARRAY_SUFFIX) for name in archive.namelist()]
            for name in members if names is None else names:
                packed = read_member(archive, name + _ARRAY_SUFFIX, left)
                left -= len(packed)
                arrays[name] = _array(packed)
    except Exception as error:  # a damaged archive surfaces as whatever zipfile and NumPy raise
        raise ValueError(one_line(error)) from error
    return arrays


def _array(content: bytes) -> npt.NDArray[Any]:
    """Parse the bytes of a .npy file; its header may claim any shape."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"an array is of version {version}: expected 1.0 or 2.0")
    shape, by_columns, dtype = _HEADERS[version](stream)
    start = stream.tell()
    if dtype.hasobject:
        raise ValueError("an array holds Python objects, and pickles are not read")
    whole = math.prod(shape) * dtype.itemsize == len(content) - start
    if not whole or max(shape, default=0) > len(content):  # as (10**12, 0)
        raise ValueError(f"an array has {len(content) - start} bytes: expected {dtype} {shape}")
    order: Any = "F" if by_columns else "C"
    return np.ndarray(shape, dtype, content, start, order=order).copy()


def in_order(content: bytes) -> bytes:
    """Sort the metadata of a safetensors file, so that equal files have equal bytes.

    The library writes the metadata in a different order each time.
    """
    start = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:start])
    header = {**header, "__metadata__": dict(sorted(header.get("__metadata__", {}).items()))}
    text = json.dumps(header, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)  # as the numbers behind it are aligned
    return len(text).to_bytes(8, "little") + text + content[start:]


def read_shapes(path: str | os.PathLike[str]) -> dict[str, tuple[int, ...]]:
    """Read the shapes of the tensors in a safetensors file from its header alone.

    Raises:
        OSError: If it is no file or cannot be read.
        ValueError: If its header is too large or damaged.
    """
    check_file(path)
    with open(path, "rb") as file:
        size = int.from_bytes(file.read(8), "little")
        if size > _MOST_OF_HEADER:
            raise ValueError(f"its header has {size} bytes, not up to {_MOST_OF_HEADER}")
        text = file.read(size)
    try:
        header = json.loads(text)
        return {n: tuple(map(int, t["shape"])) for n, t in header.items() if n != "__metadata__"}
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise ValueError("its header is damaged") from error


def check_hdf5(path: str | os.PathLike[str]) -> int:
    """Count the groups of an HDF5 file; refuse external data and oversized arrays.

    Raises:
        OSError: If it is no file or cannot be read.
        ValueError: If its arrays would take far more than its size, or are stored in other files.
        Exception: Any error of HDF5 for a damaged file.
    """
    import h5py

    check_file(path)
    left = MOST_BYTES + _MOST_PACKED * os.path.getsize(path)
    with h5py.File(path) as file:
        groups = [file]
        while groups:
            group = groups.pop()
            for name in group:
                linked = isinstance(group.get(name, getlink=True), h5py.HardLink)
                item = group[name] if linked else None
                if isinstance(item, h5py.Group):
                    groups.append(item)
                elif item is None or item.is_virtual or item.external:
                    raise ValueError(f"{group.name}/{name} stands elsewhere")
                left -= getattr(item, "nbytes", 0) + _ITEM_BYTES
                if left < 0:
                    raise ValueError("its arrays would take far more than its size")
        return len(file)
