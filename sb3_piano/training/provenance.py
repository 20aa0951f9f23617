"""Where a run comes from: command, versions, seed, threads of torch, time."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

import sb3_piano
from sb3_piano.exceptions import ConfigError
from sb3_piano.training.yaml_config import read_yaml_mapping

_PACKAGES = ("stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "numpy", "torch")


def provenance(seed: int | None) -> dict[str, Any]:
    """Return what a run's folder notes down besides the config, in YAML's types.

    Args:
        seed: The seed that the run uses.
    """
    return {
        "command": shlex.join(sys.orig_argv),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "seed": seed,
        "torch_threads": torch.get_num_threads(),
        "versions": {
            "sb3_piano": sb3_piano.__version__,
            **{package: _version(package) for package in _PACKAGES},
            "python": platform.python_version(),
        },
    }


def read_provenance(path: Path) -> Mapping[str, Any]:
    """Return what a run's folder notes of its origin; nothing if that is gone or damaged."""
    try:
        return read_yaml_mapping(path)
    except ConfigError:
        return {}


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
