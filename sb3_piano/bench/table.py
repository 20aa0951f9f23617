"""The result of a benchmark as text."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sb3_piano.bench.report import Report
from sb3_piano.bench.rows import Row
from sb3_piano.bench.settings import ENV_ID

_PARTS = {
    "simulation": "Simulation",
    "learner": "Learner",
    "training": "Whole training",
    "memory": "Full replay buffer",
}


def render(report: Report) -> RenderableType:
    """Return where the figures come from, and one table of them."""
    return Group(Text(_header(report)), _table(report.rows))


def _header(report: Report) -> str:
    machine = report.machine
    lines = [
        f"{ENV_ID}, {machine.date}",
        _listed(machine.versions),
        f"{machine.cpu}, usable cores: {machine.cores}; networks on {machine.device}, "
        f"torch threads: {machine.torch_threads}",
    ]
    if report.peer is not None:
        lines.append(f"The peer: {_listed(report.peer)}")
    rounds = max((len(row.by_round) for row in report.rows), default=0)
    lines.append(f"Rounds: {rounds}. env/bare: time of the env over that of its mj_step.")
    if report.interrupted:
        lines.append("Interrupted: what is missing was not measured.")
    return "\n".join(lines)


def _listed(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {version}" for name, version in versions.items())


def _table(rows: tuple[Row, ...]) -> Table:
    table = Table()
    table.add_column("measured", no_wrap=True)
    table.add_column("median", justify="right")
    table.add_column("ratios")
    for part, group in itertools.groupby(rows, key=lambda row: row.part):
        of_part = list(group)
        table.add_section()
        table.add_row(Text(f"{_PARTS[part]}, {of_part[0].unit}", style="bold"))
        for row in of_part:
            ratios = "\n".join(f"{rounded(value)} {label}" for label, value in row.ratios.items())
            table.add_row(Text(row.name), rounded(row.value), Text(ratios))
    return table


def rounded(value: float) -> str:
    """Return a positive number with three digits: ``0.123``, ``1.23``, ``12.3``, or ``1234``."""
    digits = 3 if value < 1 else 2 if value < 10 else 1 if value < 100 else 0
    return f"{value:.{digits}f}"
