"""Where the figures come from: versions, processor, threads. No paths, no host names."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from stable_baselines3.common.utils import get_device

import sb3_piano
from sb3_piano.threads import usable_cores

_PACKAGES = ("mujoco", "torch", "numpy", "stable_baselines3")


@dataclass(frozen=True, kw_only=True)
class Machine:
    """What the figures depend on."""

    date: str
    """When the measurement began, UTC."""
    versions: Mapping[str, str]
    """Of Python and of the packages, by name."""
    cpu: str
    """The processor's model."""
    cores: int
    """Cores that this process may use."""
    torch_threads: int
    """Threads of torch."""
    device: str
    """Where the networks are."""


def this_machine() -> Machine:
    """Return what is known of the machine, now."""
    now = datetime.datetime.now(datetime.UTC)
    return Machine(
        date=now.isoformat(sep=" ", timespec="minutes"),
        versions={
            "sb3-piano": sb3_piano.__version__,
            "python": platform.python_version(),
            **{package: importlib.metadata.version(package) for package in _PACKAGES},
        },
        cpu=cpu_model(Path("/proc/cpuinfo")),
        cores=usable_cores(),
        torch_threads=torch.get_num_threads(),
        device=_device(),
    )


def cpu_model(cpuinfo: Path) -> str:
    """Return the processor's model as Linux tells it, or what Python knows where it does not.

    Args:
        cpuinfo: Linux's description of the processors.
    """
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()


def _device() -> str:
    device = get_device("auto")
    return torch.cuda.get_device_name(device) if device.type == "cuda" else device.type
