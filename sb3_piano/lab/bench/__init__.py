"""Measure speed and memory of the package in one run (``sb3-piano bench``)."""

from __future__ import annotations

import contextlib
import datetime
import importlib.metadata
import itertools
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text
from stable_baselines3.common.utils import get_device

import sb3_piano
from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.bench.measurement import Measurement, Row, measure
from sb3_piano.lab.bench.players import player_rows
from sb3_piano.lab.bench.workloads import (
    ENV_ID,
    episode_actions,
    memory_rows,
    open_peer,
    simulation_measurements,
    training_measurements,
    update_measurements,
)
from sb3_piano.threads import processor_name, torch_computing, usable_cores

__all__ = ["PARTS", "BenchReport", "render", "run_bench"]

PARTS = ("simulation", "players", "learner", "memory")
"""Parts that can be measured."""

_PACKAGES = ("mujoco", "torch", "numpy", "stable_baselines3")
_TITLES = {
    "simulation": "Simulation",
    "players": "Players",
    "learner": "Learner",
    "training": "Whole training",
    "memory": "Full replay buffer",
}


@dataclass(frozen=True, kw_only=True)
class BenchReport:
    """Result of a benchmark."""

    machine: Mapping[str, Any]
    """Date (UTC), versions, processor, cores, threads of torch and the networks' device."""
    peer: Mapping[str, str] | None
    """Versions of RoboPianist and its dependencies, by name; ``None`` without a peer."""
    rows: Sequence[Row]
    """Measured quantities."""
    interrupted: bool
    """Whether it was interrupted before the end."""


def run_bench(
    parts: Sequence[str] = PARTS,
    rounds: int = 10,
    peer_python: str | None = None,
    before: str | None = None,
    num_threads: int | None = None,
    progress: bool = False,
) -> BenchReport:
    """Measure and return the report; after Ctrl-C, a report of the completed measurements.

    Args:
        parts: Parts to measure, of :data:`PARTS`.
        rounds: Number of rounds for medians, at least 1, after one warm-up round.
        peer_python: Interpreter with RoboPianist, to be measured, too.
        before: Folder of another version of this package, to be measured, too.
        num_threads: Threads of torch, at least 1; by default see :mod:`sb3_piano.threads`.
        progress: Whether to show a progress bar on standard error.

    Raises:
        ConfigError: If ``peer_python`` or ``before`` is given without the part "simulation".
        PeerError: If one of them cannot be started (tried first), or stops answering.
    """
    for name, given in (("peer_python", peer_python), ("before", before)):
        if given is not None and "simulation" not in parts:
            raise ConfigError(
                f"{name} is {given!r}, but the simulation is not measured: "
                f"expected 'simulation' among the parts, or no {name}."
            )
    rows: list[Row] = []
    versions, peer, interrupted = None, None, False

    def run(part: str, make: Callable[..., list[Measurement]], *arguments: Any) -> None:
        with contextlib.ExitStack() as stack:
            measure(part, make(*arguments, stack), rounds, rows, progress)

    with torch_computing(num_threads), contextlib.ExitStack() as stack:
        machine = machine_info()
        try:
            if "simulation" in parts:
                actions = episode_actions()
                if peer_python is not None:
                    versions, peer = stack.enter_context(open_peer(peer_python, actions))
                run("simulation", simulation_measurements, actions, peer, before)
            if "players" in parts:
                rows += player_rows(rounds)
            if "learner" in parts:
                run("learner", update_measurements)
                run("training", training_measurements)
            if "memory" in parts:
                rows += memory_rows()
        except KeyboardInterrupt:
            interrupted = True
    return BenchReport(machine=machine, peer=versions, rows=rows, interrupted=interrupted)


def machine_info() -> dict[str, Any]:
    """Return date, versions, processor, cores, threads and device, without paths and host names."""
    device = get_device("auto")
    return {
        "date": datetime.datetime.now(datetime.UTC).isoformat(sep=" ", timespec="minutes"),
        "versions": {
            "sb3-piano": sb3_piano.__version__,
            "python": platform.python_version(),
            **{package: importlib.metadata.version(package) for package in _PACKAGES},
        },
        "cpu": processor_name(),
        "cores": usable_cores(),
        "torch_threads": torch.get_num_threads(),
        "device": torch.cuda.get_device_name(device) if device.type == "cuda" else device.type,
    }


def render(report: BenchReport) -> RenderableType:
    """Format the report: the machine, and a table of figures."""
    machine = report.machine
    lines = [
        f"{ENV_ID}, {machine['date']}",
        _listed(machine["versions"]),
        f"{machine['cpu']}, usable cores: {machine['cores']}; networks on {machine['device']}, "
        f"torch threads: {machine['torch_threads']}",
    ]
    if report.peer is not None:
        lines.append(f"The peer: {_listed(report.peer)}")
    rounds = max((len(row.by_round) for row in report.rows), default=0)
    lines.append(f"Rounds: {rounds}. env/bare: time of the env over that of its mj_step.")
    if any(row.processor is not None for row in report.rows):
        lines.append("By processor: per second of its time, on which other programs tell less.")
    if report.interrupted:
        lines.append("Interrupted: what is missing was not measured.")
    return Group(Text("\n".join(lines)), _table(report.rows))


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def _table(rows: Sequence[Row]) -> Table:
    table, processor = Table(), any(row.processor is not None for row in rows)
    table.add_column("measured", no_wrap=True)
    table.add_column("median", justify="right")
    if processor:
        table.add_column("by processor", justify="right")
    table.add_column("ratios, by processor" if processor else "ratios")
    for (part, unit), group in itertools.groupby(rows, key=lambda row: (row.part, row.unit)):
        table.add_section()
        table.add_row(Text(f"{_TITLES[part]}, {unit}", style="bold"))
        for row in group:
            also = "" if row.processor is None else rounded(row.processor)
            ratios = Text("\n".join(_ratio(row, label) for label in row.ratios))
            table.add_row(Text(row.name), rounded(row.value), *[also] * processor, ratios)
    return table


def _ratio(row: Row, label: str) -> str:
    also = row.processor_ratios.get(label)
    return f"{rounded(row.ratios[label])}{'' if also is None else f', {rounded(also)}'} {label}"


def rounded(value: float) -> str:
    """Format a number with three digits: ``0.0123``, ``0.123``, ``1.23``, ``12.3``, ``1234``."""
    digits = max(0, 2 - math.floor(math.log10(value))) if value > 0 else 3
    return f"{value:.{digits}f}"
