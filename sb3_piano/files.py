"""Files that are either wholly there or not there at all."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Mapping
from io import BufferedWriter
from pathlib import Path
from typing import Any

PARTIAL_SUFFIX = ".partial"
"""Suffix of a file that is being written; one that is left over may be deleted."""


def write_atomically(path: Path, write: Callable[[BufferedWriter], object]) -> None:
    """Write a file so that a reader, or a killed process, never leaves or sees half of it.

    The bytes go to a neighbouring file, reach the disk, and take the final name in one step. If
    that fails the neighbouring file is deleted; only a killed process leaves it behind.

    Args:
        path: The file to create or replace; its folder must exist.
        write: Is called with the open binary file.
    """
    partial = path.with_name(path.name + PARTIAL_SUFFIX)
    try:
        with partial.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def write_bytes(path: Path, content: bytes) -> None:
    """Write bytes by :func:`write_atomically`."""
    write_atomically(path, lambda file: file.write(content))


def write_text(path: Path, text: str) -> None:
    """Write UTF-8 text by :func:`write_atomically`."""
    write_bytes(path, text.encode())


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write indented JSON by :func:`write_atomically`."""
    write_text(path, json.dumps(content, indent=2) + "\n")
