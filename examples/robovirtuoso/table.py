"""Print the report's tables with what was measured beside what the report has.

    python examples/robovirtuoso/table.py

The runs are those of ``run.py``. F1 is that of the last model without exploring: each piece's mean
over seeds, of which the mean over pieces is shown, with a 95 % interval over pieces where there are
several. Tables 3 and 4 are of the study's ``one`` piece. A dash is what was not run.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path

import yaml
from cells import HERE, RUNS, STUDY, Cell

from sb3_piano.training.evaluation.statistics import summarize

COLUMNS = ("cell", "F1", "95 % interval", "onset F1", "resting hands", "report's F1", "runs")
OF_ONE_PIECE = ("Table 3", "Table 4")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    runs = parser.parse_args().runs
    tables = yaml.safe_load((HERE / "paper.yml").read_text(encoding="utf-8"))
    for title, cells in tables.items():
        pieces = STUDY["one"] if title.startswith(OF_ONE_PIECE) else STUDY["pieces"]
        print(f"\n{title}\n")
        print_row(*COLUMNS)
        print_row(*("---" for _ in COLUMNS))
        for name, reported in cells.items():
            values = measured(Cell(name), runs, pieces)
            reports = "-" if reported is None else f"{reported:.3f}"
            print_row(name, *values[:-1], reports, values[-1])


def measured(cell: Cell, runs: Path, pieces: list[str]) -> list[str]:
    """Return F1, its interval, onset F1, resting hands' F1 and the number of runs, as text."""
    found: dict[str, list[dict[str, float]]] = defaultdict(list)
    for file in sorted((runs / cell.name).glob("*seed_*/pieces.json")):
        for evaluation in json.loads(file.read_text(encoding="utf-8"))["evaluations"]:
            if evaluation["piece"] in pieces:
                resting = {"resting": evaluation["baseline"]["f1"]}
                found[evaluation["piece"]].append({**evaluation["mean"], **resting})
    if not found:
        return ["-", "-", "-", "-", "0"]

    def by_piece(name: str) -> list[float]:
        return [sum(each[name] for each in of) / len(of) for of in found.values()]

    f1 = summarize(by_piece("f1"))
    interval = "-" if f1.interval is None else f"{f1.interval[0]:.3f} to {f1.interval[1]:.3f}"
    onset, resting = (f"{summarize(by_piece(name)).mean:.3f}" for name in ("onset_f1", "resting"))
    return [f"{f1.mean:.3f}", interval, onset, resting, str(sum(map(len, found.values())))]


def print_row(*cells: str) -> None:
    """Print a row of a Markdown table."""
    print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
