"""The result of a comparison as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from sb3_piano.cli.metric_names import label, rounded

if TYPE_CHECKING:
    from sb3_piano.training import Comparison
    from sb3_piano.training.compare import MetricComparison


def pairs_table(comparison: Comparison) -> Table:
    """Return each pair of each metric."""
    table = Table()
    for heading, justify in (("pair", "left"), ("A", "right"), ("B", "right"), ("B - A", "right")):
        table.add_column(heading, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for found in comparison.metrics:
        table.add_section()
        table.add_row(Text(label(found.metric), style="bold"))
        for pair in found.pairs:
            name = pair.piece if pair.seed is None else f"{pair.piece}, seed {pair.seed}"
            values = (rounded(found.metric, pair.a), rounded(found.metric, pair.b))
            table.add_row(*map(Text, (name, *values, _signed(found.metric, pair.difference))))
    return table


def summary_table(comparison: Comparison) -> Table:
    """Return the statistics of each metric."""
    table = Table()
    table.add_column("metric")
    for heading in ("mean A", "mean B", "B - A", "95 % interval", "A < B", "Wilcoxon p"):
        table.add_column(heading, justify="right")
    for found in comparison.metrics:
        means = (rounded(found.metric, mean) for mean in (found.mean_a, found.mean_b))
        difference = _signed(found.metric, found.difference.mean)
        below = f"{found.n_a_below_b} of {len(found.pairs)}"
        row = (label(found.metric), *means, difference, _interval(found), below, _p(found))
        table.add_row(*map(Text, row))
    return table


def notes(comparison: Comparison) -> list[str]:
    """Return in words what the tables do not tell."""
    lines = []
    if comparison.physics_a != comparison.physics_b or len(comparison.physics_a) > 1:
        lines.append(
            f"Not played on the same physics: A on {' and '.join(comparison.physics_a)}, B on "
            f"{' and '.join(comparison.physics_b)}. To play both on one: sb3-piano evaluate "
            "--physics."
        )
    for side, missing in (("A", comparison.only_in_a), ("B", comparison.only_in_b)):
        if missing:
            lines.append(f"Left out, as only {side} has them: {'; '.join(missing)}.")
    remarks: dict[str, list[str]] = {}
    for found in comparison.metrics:
        for remark in _remarks(found):
            remarks.setdefault(remark, []).append(label(found.metric))
    for remark, names in remarks.items():
        of_all = len(names) == len(comparison.metrics)
        lines.append(f"{remark}." if of_all else f"{remark} ({', '.join(names)}).")
    return lines


def _remarks(found: MetricComparison) -> Iterator[str]:
    test = found.test
    if found.difference.no_interval is not None:
        yield f"No interval: {found.difference.no_interval}"
    if test.no_test is not None:
        yield f"No test: {test.no_test}"
        return
    n_equal = len(found.pairs) - test.n
    if n_equal > 0:
        yield f"{n_equal} equal {_pairs(n_equal)} left out of the test"
    if test.least_p is not None and test.least_p > 0.05:
        yield f"With {test.n} {_pairs(test.n)} p cannot be below {test.least_p:g}"


def _pairs(count: int) -> str:
    return "pair" if count == 1 else "pairs"


def _signed(metric: str, value: float) -> str:
    text = rounded(metric, value)
    return f"+{text}" if float(text) > 0 else text


def _interval(found: MetricComparison) -> str:
    interval = found.difference.interval
    if interval is None:
        return "-"
    return "..".join(_signed(found.metric, end) for end in interval)


def _p(found: MetricComparison) -> str:
    p = found.test.p
    if p is None:
        return "-"
    return "< 0.0001" if p < 0.0001 else f"{p:.3g}"
