"""``sb3-piano compare``: compare two sets of evaluations, piece by piece."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    add_row,
    check_output_file,
    command,
    new_table,
    print_narrowness,
    print_table,
)

if TYPE_CHECKING:
    from rich.table import Table

    from sb3_piano.training.evaluation.comparison import Comparison, MetricComparison

_BY_HELP = (
    "unit of a pair: the mean of a piece (default), or of a piece and evaluation seed, or of a "
    "piece and training seed"
)


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _compare)
    add("a", "A", "a JSON file from evaluate, an evaluated run, or a folder of evaluated runs")
    add("b", "B", "as A; differences are B - A")
    add("--metric", "NAME", "metric to compare, such as f1; repeatable", action="append")
    by = ("piece", "seed", "training-seed")
    add("--by", text=_BY_HELP, default="piece", choices=by)
    add("--csv", text="write one row per metric and pair to a CSV file")
    add("--json")
    add("--plot", "FILE", "plot the sorted differences to a .png, .svg or .pdf", Path)


def _compare(arguments: argparse.Namespace) -> int:
    from sb3_piano.files import write_json
    from sb3_piano.training import compare
    from sb3_piano.training.evaluation.difference_plot import picture_format

    if arguments.plot is not None:
        check_output_file("--plot", arguments.plot)
        picture_format(arguments.plot)
    comparison = compare(arguments.a, arguments.b, arguments.metric, by=arguments.by)
    _show_comparison(comparison)
    if arguments.csv is not None:
        comparison.write_csv(arguments.csv)
        print(f"Pairs:      {arguments.csv}")
    if arguments.json is not None:
        write_json(arguments.json, comparison.to_json())
        print(f"Everything: {arguments.json}")
    if arguments.plot is not None:
        comparison.plot(arguments.plot)
        print(f"Picture:    {arguments.plot}")
    return EXIT_OK


def _show_comparison(comparison: Comparison) -> None:
    print(f"A: {comparison.a}\nB: {comparison.b}")
    print_table(_pairs_table(comparison))
    print_table(_summary_table(comparison))
    for note in _notes(comparison):
        print(note)
    if any(found.difference.interval is not None for found in comparison.metrics):
        print_narrowness(len(comparison.metrics[0].pairs))


def _pairs_table(comparison: Comparison) -> Table:
    """Return a table of all pairs of each metric."""
    from sb3_piano.cli.evaluation_tables import label, rounded

    table = new_table("pair", "A", "B", "B - A")
    for found in comparison.metrics:
        table.add_section()
        add_row(table, label(found.metric), style="bold")
        for pair in found.pairs:
            values = (rounded(found.metric, pair.a), rounded(found.metric, pair.b))
            add_row(table, pair.name, *values, _signed(found.metric, pair.difference))
    return table


def _summary_table(comparison: Comparison) -> Table:
    """Return a table of the statistics of each metric."""
    from sb3_piano.cli.evaluation_tables import label, rounded

    headings = ("mean A", "mean B", "B - A", "95 % interval", "A < B", "A <= B", "Wilcoxon p")
    table = new_table("metric", *headings)
    for found in comparison.metrics:
        metric, interval, p = found.metric, found.difference.interval, found.test.p
        add_row(
            table,
            label(metric),
            rounded(metric, found.mean_a),
            rounded(metric, found.mean_b),
            _signed(metric, found.difference.mean),
            "-" if interval is None else "..".join(_signed(metric, end) for end in interval),
            f"{found.n_a_below_b}/{len(found.pairs)}",
            f"{found.n_a_not_above_b}/{len(found.pairs)}",
            "-" if p is None else "< 0.0001" if p < 0.0001 else f"{p:.3g}",
        )
    return table


def _signed(metric: str, value: float) -> str:
    from sb3_piano.cli.evaluation_tables import rounded

    text = rounded(metric, value)
    return f"+{text}" if float(text) > 0 else text


def _notes(comparison: Comparison) -> Iterator[str]:
    """Yield notes on facts that the tables do not show."""
    from sb3_piano.cli.evaluation_tables import label

    if comparison.physics_a != comparison.physics_b or len(comparison.physics_a) > 1:
        yield (
            f"Not played on the same physics: A on {' and '.join(comparison.physics_a)}, B on "
            f"{' and '.join(comparison.physics_b)}. To play both on one: sb3-piano evaluate "
            "--physics."
        )
    for side, missing in (("A", comparison.only_in_a), ("B", comparison.only_in_b)):
        if missing:
            yield f"Left out, as only {side} has them: {'; '.join(missing)}."
    remarks: dict[str, list[str]] = {}
    for found in comparison.metrics:
        for remark in _remarks(found):
            remarks.setdefault(remark, []).append(label(found.metric))
    for remark, names in remarks.items():
        of_all = len(names) == len(comparison.metrics)
        yield f"{remark}." if of_all else f"{remark} ({', '.join(names)})."


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
