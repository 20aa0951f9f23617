"""Provenance of a run: command, time, seed and versions."""

from __future__ import annotations

import contextlib
import datetime
import functools
import importlib.metadata
import platform
import shlex
import sys
from typing import Any

import sb3_piano

_PACKAGES = ("stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "numpy", "torch")


def provenance(seed: int | None) -> dict[str, Any]:
    """Return the content of a run's ``run.yml``, in YAML's types."""
    import torch  # here, as players need no torch

    return {
        "command": shlex.join(sys.orig_argv),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "seed": seed,
        "torch_threads": torch.get_num_threads(),
        "matmul_precision": torch.get_float32_matmul_precision(),
        "versions": versions(),
    }


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of the installed packages; their metadata are read once."""
    found = {"sb3_piano": sb3_piano.__version__}
    for package in _PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):  # players need few
            found[package] = importlib.metadata.version(package)
    return {**found, "python": platform.python_version()}
