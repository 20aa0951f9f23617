"""The results of evaluations as tables."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from sb3_piano.cli.metric_names import label, rounded, short_label
from sb3_piano.metrics import DEFINITIONS, FINGER_SHARES, has_value

if TYPE_CHECKING:
    from sb3_piano.training import Evaluation

_NOTHING = "-"
_SHARES = {
    "shares, right thumb to little": FINGER_SHARES[:5],
    "shares, left thumb to little": FINGER_SHARES[5:],
}
_METRICS_IN_TABLE = 5


def one_run_table(evaluation: Evaluation, metrics: Sequence[str] | None = None) -> Table:
    """Return all metrics of one evaluation, or the named ones, by section."""
    several = len(evaluation.episodes) > 1
    with_interval = any(summary.interval for summary in evaluation.summary.values())
    table = Table()
    table.add_column("metric")
    table.add_column("policy (mean ± std)" if several else "policy", justify="right")
    if with_interval:
        table.add_column("95 % interval", justify="right")
    if evaluation.baseline is not None:
        table.add_column("no-op baseline", justify="right")
    names = [name for name in _rows(metrics) if name in evaluation.summary]
    for section, group in itertools.groupby(names, key=lambda name: DEFINITIONS[name].section):
        table.add_section()
        table.add_row(Text(section, style="bold"))
        for name in group:
            cells = [f"  {short_label(name)}", _mean_and_std(evaluation, name)]
            if with_interval:
                cells.append(_interval(evaluation, name))
            if evaluation.baseline is not None:
                cells.append(_value(evaluation.baseline, name))
            table.add_row(*map(Text, cells))
        if section == "Fingers" and metrics is None:
            _add_shares(table, evaluation, with_interval)
    return table


def several_runs_tables(
    evaluations: Sequence[Evaluation], metrics: Sequence[str]
) -> Iterator[Table]:
    """Yield tables of the named metrics of several evaluations, grouped by piece.

    Under each mean stands its 95 % interval, if it has one. A table has as many metrics as fit
    beside each other on most terminals.
    """
    for start in range(0, len(metrics), _METRICS_IN_TABLE):
        yield _several_runs_table(evaluations, metrics[start : start + _METRICS_IN_TABLE])


def common_parent(evaluations: Iterable[Evaluation]) -> Path:
    """Return the nearest folder that all runs are in; ``.`` if they share none."""
    parents = [evaluation.run.parent for evaluation in evaluations]
    try:
        return Path(os.path.commonpath(parents))
    except ValueError:  # absolute and relative ones
        return Path()


def _several_runs_table(evaluations: Sequence[Evaluation], metrics: Sequence[str]) -> Table:
    table = Table()
    table.add_column("piece and run", overflow="fold")
    for name in metrics:
        table.add_column(label(name).replace(" ", "\n"), justify="right", no_wrap=True)
    parent = common_parent(evaluations)
    by_piece: dict[str, list[Evaluation]] = {}
    for evaluation in evaluations:
        by_piece.setdefault(evaluation.piece, []).append(evaluation)
    for piece, of_piece in by_piece.items():
        table.add_section()
        table.add_row(Text(piece, style="bold"))
        for evaluation in of_piece:
            cells = [_mean_and_interval(evaluation, name) for name in metrics]
            table.add_row(*map(Text, (_name(evaluation, parent), *cells)))
        for heading, cells in _baselines(of_piece, metrics, parent):
            table.add_row(Text(heading, style="italic"), *map(Text, cells))
    return table


def _name(evaluation: Evaluation, parent: Path) -> str:
    return str(evaluation.run.relative_to(parent) if parent != Path() else evaluation.run)


def _rows(metrics: Sequence[str] | None) -> list[str]:
    if metrics is not None:
        return [name for name in DEFINITIONS if name in metrics]
    compact = {"noop_f1", *FINGER_SHARES}  # in a column, or five in a row
    return [name for name in DEFINITIONS if name not in compact]


def _add_shares(table: Table, evaluation: Evaluation, with_interval: bool) -> None:
    for text, names in _SHARES.items():
        cells = [f"  {text}", _shares(evaluation.mean, names)]
        if with_interval:
            cells.append("")
        if evaluation.baseline is not None:
            cells.append(_shares(evaluation.baseline, names))
        table.add_row(*map(Text, cells))


def _shares(metrics: Mapping[str, float], names: Sequence[str]) -> str:
    shares = [metrics[name] for name in names]
    return (
        " ".join(f"{share:.2f}".removeprefix("0") for share in shares) if any(shares) else _NOTHING
    )


def _value(metrics: Mapping[str, float], name: str) -> str:
    """Return a rounded value; a dash where there is none."""
    return rounded(name, metrics[name]) if has_value(name, metrics) else _NOTHING


def _mean_and_std(evaluation: Evaluation, name: str) -> str:
    value = _value(evaluation.mean, name)
    if len(evaluation.episodes) == 1 or value == _NOTHING:
        return value
    return f"{value} ± {rounded(name, evaluation.std[name])}"


def _interval(evaluation: Evaluation, name: str) -> str:
    interval = evaluation.summary[name].interval
    if interval is None or _value(evaluation.mean, name) == _NOTHING:
        return ""
    low, high = (rounded(name, end) for end in interval)
    return f"{low}..{high}"


def _mean_and_interval(evaluation: Evaluation, name: str) -> str:
    if name not in evaluation.summary:
        return _NOTHING
    return f"{_value(evaluation.mean, name)}\n{_interval(evaluation, name)}".rstrip()


def _baselines(
    evaluations: Sequence[Evaluation], metrics: Sequence[str], parent: Path
) -> list[tuple[str, list[str]]]:
    """Return what playing nothing scores: once if it is the same for all runs on a piece."""
    rows = [
        (_name(evaluation, parent), [_value(evaluation.baseline, name) for name in metrics])
        for evaluation in evaluations
        if evaluation.baseline is not None
    ]
    if all(cells == rows[0][1] for _, cells in rows):
        return [("no-op baseline", cells) for _, cells in rows[:1]]
    return [(f"no-op baseline of {run}", cells) for run, cells in rows]
