"""Print the paper's tables 1 to 3 with what was measured beside what the paper has.

    python examples/sac_vs_td3/table.py
    python examples/sac_vs_td3/table.py --keep   # and add the runs' figures to results.json

The runs are those of ``run.py`` and, where a folder is gone, those that results.json has kept.
Where a cell was trained from several seeds, means are shown. A dash is what was not run, or what
the paper does not have. An F1 within 0.05 of that of resting hands is marked as the floor.
"""

from __future__ import annotations

import argparse
import contextlib
import statistics
from collections.abc import Iterable, Mapping
from pathlib import Path

import yaml
from cells import HERE, RUNS, Cell, find_cells
from results import KEPT, keep, results_of

from sb3_piano.training.runs.builders import build_vec_env

COLUMNS = {
    "return": "{:.1f}",
    "in training": "{:.1f}",
    "paper's return": "{:.1f}",
    "resting hands": "{:.1f}",
    "return / step": "{:.2f}",
    "F1": "{:.3f}",
    "onset F1": "{:.3f}",
    "resting F1": "{:.3f}",
    "Q": "{:.1f}",
    "paper's Q": "{:.1f}",
    "actor loss": "{:.1f}",
    "paper's actor loss": "{:.1f}",
    "critic loss": "{:.2f}",
    "paper's critic loss": "{:.2f}",
    "seeds": "{:.0f}",
}
FLOOR = 0.05
"""An F1 by so much above that of resting hands, or less, is no playing."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    add("--kept", type=Path, default=KEPT, metavar="FILE", help="default: results.json beside this")
    add("--keep", action="store_true", help="add the figures of the runs to that file")
    add("--resting", action="store_true", help="let hands rest also in cells that were not run")
    arguments = parser.parse_args()
    cells = {cell.name: cell for cell in find_cells()}
    if arguments.keep:
        count = keep(list(cells.values()), arguments.runs, arguments.kept)
        print(f"{count} runs are kept in {arguments.kept}")
    for title, rows in yaml.safe_load((HERE / "paper.yml").read_text(encoding="utf-8")).items():
        print(f"\n{title}\n")
        print_row("cell", COLUMNS)
        print_row("---", ["---:"] * len(COLUMNS))
        for name, paper in rows.items():
            values = {**measured(cells[name], arguments.runs, arguments.kept), **(paper or {})}
            if arguments.resting and "resting hands" not in values:
                values["resting hands"] = resting_return(cells[name])
            print_row(name, [shown(values, column) for column in COLUMNS])


def measured(cell: Cell, runs: Path, kept: Path) -> dict[str, float]:
    """Return the columns that the runs of a cell give; empty if there are none.

    They are means over the seeds that have the column: the earliest runs have no Q.
    """
    found = [result.columns for result in results_of(cell, runs, kept).values()]
    if not found:
        return {}
    means = {
        name: statistics.fmean(values[name] for values in found if name in values)
        for name in COLUMNS
        if any(name in values for values in found)
    }
    return {**means, "seeds": len(found)}


def resting_return(cell: Cell) -> float:
    """Return what hands earn that do nothing for an episode of a cell."""
    with contextlib.closing(build_vec_env(cell.config(seed=0))) as venv:
        (action,) = venv.get_attr("rest_action")
        venv.reset()
        done, total = False, 0.0
        while not done:
            _, (reward,), (done,), _ = venv.step([action])
            total += float(reward)
    return total


def shown(values: Mapping[str, float], column: str) -> str:
    """Return a number as text."""
    if column not in values:
        return "-"
    text = COLUMNS[column].format(values[column])
    resting = values.get("resting F1", 0.0)
    return f"{text} floor" if column == "F1" and values["F1"] < resting + FLOOR else text


def print_row(first: str, others: Iterable[str]) -> None:
    """Print a row of a Markdown table."""
    print(f"| {' | '.join([first, *others])} |")


if __name__ == "__main__":
    main()
