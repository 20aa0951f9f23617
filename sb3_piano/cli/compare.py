"""``sb3-piano compare``: what two evaluations reach at the same pieces."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import EXIT_OK, check_output_file, print_narrowness

if TYPE_CHECKING:
    from sb3_piano.training import Comparison


def add_parser(commands: Any) -> None:
    """Add the command and its arguments."""
    compare = commands.add_parser("compare", help="compare two evaluations piece by piece")
    add = compare.add_argument
    source = "a JSON file of evaluate, an evaluated run, or a folder of evaluated runs"
    add("a", metavar="A", help=source)
    add("b", metavar="B", help="likewise; differences are B - A")
    add("--metric", action="append", metavar="NAME", help="such as f1; may be given several times")
    add(
        "--by",
        choices=("piece", "seed", "training-seed"),
        default="piece",
        help="pair the means of each piece (default), or those of each seed of a piece: of the "
        "evaluation, or of the training",
    )
    add("--csv", type=Path, metavar="FILE", help="write a row for each metric and pair")
    add("--json", type=Path, metavar="FILE", help="write everything, statistics included")
    compare.set_defaults(command=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    for option in ("csv", "json"):
        check_output_file(f"--{option}", getattr(arguments, option))
    from sb3_piano.files import write_json
    from sb3_piano.training import compare

    comparison = compare(arguments.a, arguments.b, arguments.metric, by=arguments.by)
    _show(comparison)
    if arguments.csv is not None:
        comparison.write_csv(arguments.csv)
        print(f"Pairs:      {arguments.csv}")
    if arguments.json is not None:
        write_json(arguments.json, comparison.to_json())
        print(f"Everything: {arguments.json}")
    return EXIT_OK


def _show(comparison: Comparison) -> None:
    from rich.console import Console

    from sb3_piano.cli.comparison_tables import notes, pairs_table, summary_table

    print(f"A: {comparison.a}\nB: {comparison.b}")
    console = Console()
    console.print(pairs_table(comparison))
    console.print(summary_table(comparison))
    for note in notes(comparison):
        print(note)
    if any(found.difference.interval is not None for found in comparison.metrics):
        print_narrowness(len(comparison.metrics[0].pairs))
