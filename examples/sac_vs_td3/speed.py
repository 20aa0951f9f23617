"""Compare the speed of training cells of the tables, side by side in one process.

    OMP_NUM_THREADS=1 python examples/sac_vs_td3/speed.py td3/d_major td3/d_major_36_keys

Each trains for some steps in turn, round after round, so that a busy machine is busy for all. The
first one is what the others are compared with.
"""

from __future__ import annotations

import argparse
import contextlib

from cells import find_cells
from rich import print as rich_print

from sb3_piano.lab.bench.measurement import Measurement, Row, measure
from sb3_piano.lab.bench.workloads import TRANSITIONS, training_measurement
from sb3_piano.training import load_config

TABLE_3 = ["td3/d_major", "td3/d_major_36_keys", "td3/d_major_piece_keys"]


def main() -> None:
    """Measure the cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cells", nargs="*", default=TABLE_3, help="default: those of table 3")
    parser.add_argument("--rounds", type=int, default=20, metavar="N", help="default: 20")
    arguments = parser.parse_args()
    with contextlib.ExitStack() as stack:
        rows: list[Row] = []
        trainings = measurements(arguments.cells, stack)
        measure("training", trainings, arguments.rounds, rows, progress=True)
    for row in rows:
        ratios = ", ".join(f"{value:.2f} {label}" for label, value in row.ratios.items())
        rich_print(f"{row.name}: {row.value:.1f} {row.unit}; {ratios}")


def measurements(names: list[str], stack: contextlib.ExitStack) -> list[Measurement]:
    """Return the trainings of some cells, ready to learn."""
    small = {"seed": 0, "learning_starts": TRANSITIONS, "callback": None}
    cells = find_cells(names)
    base = cells[0].name
    found = []
    for cell in cells:
        config = load_config(cell.algo, cell.env_id, cell.path, **small)
        versus = None if cell.name == base else base
        found.append(training_measurement(cell.name, config, stack, versus))
    return found


if __name__ == "__main__":
    main()
