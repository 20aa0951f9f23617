"""Print the report's tables with what was measured beside what the report has.

    python examples/robovirtuoso/table.py
    python examples/robovirtuoso/table.py --keep   # and add the runs' figures to results.json

The runs are those of ``run.py`` and, where a folder is gone, those that results.json has kept. F1
is that of the last model without exploring: each piece's mean over seeds, of which the mean over
pieces is shown, with a 95 % interval over pieces where there are several, otherwise with the least
and the greatest of the seeds. Tables 3 and 4 are of the study's ``one`` piece; the last tables are
of whole pieces that a policy has not seen. A dash is what was not run. An F1 within 0.05 of that of
resting hands is marked as the floor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import yaml
from cells import HERE, RUNS, SIGHT_READER, STUDY, Cell, find_cells

from sb3_piano.files import write_text
from sb3_piano.training import RunFolder
from sb3_piano.training.evaluation.statistics import summarize

KEPT = HERE / "results.json"
COLUMNS = ("cell", "F1", "interval", "onset F1", "resting hands", "report's F1", "runs")
OF_ONE_PIECE = ("Table 3", "Table 4")
FLOOR = 0.05
"""An F1 by so much above that of resting hands, or less, is no playing."""

Results = dict[str, dict[str, list[float]]]
"""By run, such as ``table_2/hindsight/scale-CMajor_seed_0``, and piece: F1, onset F1, and the F1 of
resting hands."""


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    add("--kept", type=Path, default=KEPT, metavar="FILE", help="default: results.json beside this")
    add("--keep", action="store_true", help="add the figures of the runs to that file")
    arguments = parser.parse_args()
    results = read_kept(arguments.kept)
    if arguments.keep:
        whole = read_runs(arguments.runs, only_whole=True)
        all_runs = sorted({**results, **whole}.items())
        rows = [f"  {json.dumps(run)}: {json.dumps(of_piece)}" for run, of_piece in all_runs]
        write_text(arguments.kept, "{\n" + ",\n".join(rows) + "\n}\n")
        print(f"{len(whole)} runs are kept in {arguments.kept}")
    results.update(read_runs(arguments.runs))
    tables = yaml.safe_load((HERE / "paper.yml").read_text(encoding="utf-8"))
    for title, cells in tables.items():
        pieces = STUDY["one"] if title.startswith(OF_ONE_PIECE) else STUDY["pieces"]
        print_table(title, cells, pieces, results)
    together = {cell.name: None for cell in find_cells() if cell.is_together}
    together[SIGHT_READER] = None
    for piece in STUDY["unseen"]:
        print_table(f"Not seen in training: {piece}", together, [piece], results)


def read_runs(runs: Path, *, only_whole: bool = False) -> Results:
    """Return the figures of the runs in a folder, or of those only that are of full length."""
    results: Results = {}
    for name in (*STUDY["cells"], SIGHT_READER):
        for file in sorted((runs / name).glob("*seed_*/pieces.json")):
            evaluations = json.loads(file.read_text(encoding="utf-8"))["evaluations"]
            if only_whole and name != SIGHT_READER:
                config = RunFolder.open(file.parent).read_config()
                steps = Cell(name).settings.n_timesteps
                judged = min(one["num_timesteps"] for one in evaluations)
                if config.n_timesteps != steps or judged < steps:
                    continue
            results[f"{name}/{file.parent.name}"] = {
                one["piece"]: [
                    round(value, 4)
                    for value in (one["mean"]["f1"], one["mean"]["onset_f1"], one["baseline"]["f1"])
                ]
                for one in evaluations
            }
    return results


def read_kept(file: Path) -> Results:
    """Return the figures that a file has kept; none if there is no such file."""
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def print_table(
    title: str, cells: dict[str, float | None], pieces: Sequence[str], results: Results
) -> None:
    """Print a row for each cell, with what the report has for it."""
    print(f"\n{title}\n")
    print_row(*COLUMNS)
    print_row(*("---" for _ in COLUMNS))
    for name, reported in cells.items():
        *values, runs = measured(name, pieces, results)
        print_row(name, *values, "-" if reported is None else f"{reported:.3f}", runs)


def measured(cell: str, pieces: Sequence[str], results: Results) -> list[str]:
    """Return F1, its interval, onset F1, resting hands' F1 and the number of runs, as text."""
    of_cell = [of for run, of in results.items() if run.rpartition("/")[0] == cell]
    found = [[of[piece] for of in of_cell if piece in of] for piece in pieces]
    found = [of_piece for of_piece in found if of_piece]
    if not found:
        return ["-", "-", "-", "-", "0"]
    by_piece = [[sum(values) / len(of) for values in zip(*of, strict=True)] for of in found]
    f1, onset_f1, resting = (summarize(values) for values in zip(*by_piece, strict=True))
    seeds = [of[0] for of in found[0]]
    low, high = f1.interval or (min(seeds), max(seeds))
    interval = "-" if low == high else f"{low:.3f} to {high:.3f}"
    means = (f"{each.mean:.3f}" for each in (onset_f1, resting))
    floor = " floor" if f1.mean < resting.mean + FLOOR else ""
    return [f"{f1.mean:.3f}{floor}", interval, *means, str(sum(map(len, found)))]


def print_row(*cells: str) -> None:
    """Print a row of a Markdown table."""
    print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
