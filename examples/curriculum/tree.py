"""Let trained policies look ahead, on the piece that they know and on one that they do not.

    python examples/curriculum/tree.py               # trains what is missing, and prints the table
    python examples/curriculum/tree.py --seeds 0     # of one seed: a third of the time
    python examples/curriculum/tree.py --report examples/curriculum/kept/tree.json

Table 2 of "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", at a size
for one core: six trainings of eight minutes, then trees of 64 simulations, 1 and 8 control steps
deep, and narrow ones of 256, which do get that deep. An untrained policy searches as well, to see
what comes of the simulator alone. What is finished is kept: the same command goes on after Ctrl-C
or a crash.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

from seeds import over_seeds

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.files import write_json
from sb3_piano.training import evaluate, load_config, resume, train
from sb3_piano.training.runs.train import TrainResult

HERE = Path(__file__).parent
KNOWN, UNSEEN = "repertoire-PathetiqueRondo", "repertoire-FantaisieImpromptu"
UNTRAINED = "untrained"
TREES = (None, "64x1", "64x8", "256x8x0.5")
COLUMNS = {
    "onset_f1": "onset F1",
    "f1": "F1",
    "effective_fingers": "fingers",
    "deepest": "depth reached",
    "visit_share": "visits to the best",
}
DIGITS = {"effective_fingers": 1, "deepest": 1, "visit_share": 2}
"""Of columns that have no range."""
FLOOR = 0.05  # F1 above that of playing nothing

Row = dict[str, Any]
"""What a seed's policy reaches on a piece with a tree, or without."""


def main() -> int:
    """Train, search and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--steps", type=int, metavar="N", help="default: those of right_hand.yml")
    add("--runs", type=Path, default=Path("runs/curriculum/tree"), metavar="DIR")
    add("--report", type=Path, metavar="FILE", help="print the table of a results.json, no more")
    arguments = parser.parse_args()
    if arguments.report is not None:
        print_table(json.loads(arguments.report.read_text("utf-8"))["cells"])
        return 0
    policies = [(KNOWN, KNOWN), (KNOWN, UNSEEN), (UNTRAINED, UNSEEN)]
    cells = [(policy, piece, tree) for policy, piece in policies for tree in TREES]
    rows: list[Row] = []
    try:
        for policy, piece, tree in [*cells, (UNSEEN, UNSEEN, None)]:
            for seed in arguments.seeds:
                folder = arguments.runs / f"{policy}_seed_{seed}"
                steps = 8 if policy == UNTRAINED else arguments.steps
                run = trained(folder, UNSEEN if policy == UNTRAINED else policy, seed, steps)
                if run.interrupted:
                    raise KeyboardInterrupt
                found = played(folder, piece, tree, run.num_timesteps)
                rows.append({"policy": policy, "piece": piece, "tree": tree, "seed": seed} | found)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    write_json(arguments.runs / "results.json", {"cells": rows})
    print_table(rows)
    return 0


def print_table(rows: Sequence[Row]) -> None:
    """Print means over seeds."""
    print(f"| policy | piece | tree | {' | '.join(COLUMNS.values())} |")
    print("|" + " --- |" * (3 + len(COLUMNS)))
    cells: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        names = (row["policy"], row["piece"], row["tree"] or "none")
        cells.setdefault(names, []).append(row)
    for names, seeds in cells.items():
        measured = {name: [row[name] for row in seeds if name in row] for name in COLUMNS}
        shown = [over_seeds(measured["onset_f1"]), over_seeds(measured["f1"])]
        if fmean(row["f1"] - row["noop_f1"] for row in seeds) < FLOOR:
            shown[1] += " floor"
        for name, digits in DIGITS.items():
            shown.append(f"{fmean(measured[name]):.{digits}f}" if measured[name] else "")
        cell = [*(name.removeprefix("repertoire-") for name in names), *shown]
        print(f"| {' | '.join(cell)} |")


def trained(folder: Path, piece: str, seed: int, steps: int | None) -> TrainResult:
    """Bring a training to its end, unless it is interrupted."""
    options = {} if steps is None else {"n_timesteps": steps}
    config = load_config(
        "sac", f"RoboPianist-{piece}-v0", HERE / "right_hand.yml", seed=seed, **options
    )
    if (folder / "config.yml").is_file():
        return resume(folder, config.n_timesteps)
    return train(config, folder)


def played(folder: Path, piece: str, tree: str | None, steps: int) -> dict[str, float]:
    """Return what a policy of so many steps reaches with a tree or without."""
    file = folder / "trees" / f"{piece}_{tree}.json"
    found: dict[str, Any] = json.loads(file.read_text("utf-8")) if file.is_file() else {}
    if found.get("num_timesteps") != steps:  # the training may have gone on since
        player = str(folder) if tree is None else f"tree:{tree}:{folder}"
        file.parent.mkdir(exist_ok=True)
        found = evaluate(player, score=piece).to_json()
        write_json(file, found)
    numbers = {**found["mean"], **(found["tree"] or {})}
    return {name: numbers[name] for name in (*COLUMNS, "noop_f1") if name in numbers}


if __name__ == "__main__":
    raise SystemExit(main())
