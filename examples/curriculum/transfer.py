"""Easier pieces before a hard one, or the hard one alone for as many steps.

    python examples/curriculum/transfer.py                   # seeds 0 to 2
    python examples/curriculum/transfer.py --seeds 0 --workers 1

Section 5 of "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", at a size
for one core: the four stages of repertoire.yml, five minutes each, and beside them Clair de lune
and the Maple Leaf Rag alone. These are trained in equal stages, too, each from the one before, so
that their first is the paper's comparison (as many steps of the piece) and their last one that at
an equal total. The stages of both targets are also trained with an entropy coefficient that begins
anew. What is finished is kept: the same command goes on after Ctrl-C or a crash.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seeds import over_seeds

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.files import write_json
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import map_jobs, open_executor
from sb3_piano.pipelines import load_curriculum, run_curriculum
from sb3_piano.training import evaluate

FILE = Path(__file__).parent / "repertoire.yml"
PIECES = tuple(str(stage.piece) for stage in load_curriculum(FILE).stages)
TARGETS = PIECES[2:]
COLUMNS = {"f1": "F1", "non_silent_f1": "non-silent F1", "onset_f1": "onset F1", "return": "return"}

Metrics = dict[tuple[str, int], dict[str, float]]
"""By piece and number of the stage."""
Row = dict[str, Any]
"""Cell of the table: each metric has a number for each seed."""


@dataclass(frozen=True)
class Chain:
    """Curriculum of stages that differ in their pieces alone, from a seed."""

    name: str
    pieces: tuple[str, ...]
    seed: int
    runs: Path
    steps: int | None
    start: Path | None = None
    """Run that the first stage starts from, but for its entropy coefficient."""

    @property
    def folder(self) -> Path:
        """Folder of all files."""
        return self.runs / f"{self.name}_seed_{self.seed}"


def trained(chain: Chain) -> tuple[str, Metrics]:
    """Train what is missing of a chain; return its name and what each stage's last model reaches.

    Raises:
        KeyboardInterrupt: If it was interrupted; the next call goes on.
    """
    curriculum = load_curriculum(FILE)
    first = curriculum.stages[0]
    changed = {} if chain.steps is None else {"n_timesteps": chain.steps}
    settings = {**first.settings, **changed}
    first = dataclasses.replace(first, settings=settings, with_entropy=chain.start is None)
    curriculum = dataclasses.replace(
        curriculum,
        seed=chain.seed,
        stages=tuple(dataclasses.replace(first, piece=piece) for piece in chain.pieces),
        init_from=None if chain.start is None else str(chain.start),
    )
    runs = run_curriculum(curriculum, chain.folder, progress_bar=False)
    if runs[-1].result is None:
        raise KeyboardInterrupt
    found: Metrics = {}
    for number, (piece, run) in enumerate(zip(chain.pieces, runs, strict=True), start=1):
        judged = evaluate(run.job.folder)
        if judged.interrupted:
            raise KeyboardInterrupt
        found[piece, number] = dict(judged.mean)
    return chain.name, found


def rows_of(found: Mapping[str, Sequence[Metrics]]) -> list[Row]:
    """Return the table's cells, of what the chains of each name reached, one entry a seed."""
    rows: list[Row] = []
    for piece in TARGETS:
        number = PIECES.index(piece) + 1
        cells = {
            "after easier ones": ("stages", number),
            "after them, exploring anew": (f"{piece}_anew", 1),
            "alone, as many steps of it": (piece, 1),
            "alone, as many steps in all": (piece, number),
        }
        for text, (name, stage) in cells.items():
            of_seeds = [metrics[piece, stage] for metrics in found[name]]
            columns = {metric: [mean[metric] for mean in of_seeds] for metric in COLUMNS}
            rows.append({"piece": piece, "trained": text, **columns})
    return rows


def print_table(rows: Sequence[Row]) -> None:
    """Print means over seeds."""
    print(f"| piece | trained | {' | '.join(COLUMNS.values())} |")
    print("|" + " --- |" * (2 + len(COLUMNS)))
    for row in rows:
        columns = [over_seeds(row[metric]) for metric in COLUMNS]
        print(f"| {row['piece']} | {row['trained']} | {' | '.join(columns)} |")


def main() -> int:
    """Train what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--steps", type=int, metavar="N", help="of each stage; default: those of repertoire.yml")
    add("--runs", type=Path, default=Path("runs/curriculum/transfer"), metavar="DIR")
    add("--report", type=Path, metavar="FILE", help="print the table of a results.json, no more")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="trainings at once; default: one a core"
    )
    where.add_argument("--ray", metavar="ADDRESS", help="train on a cluster that sees the runs")
    arguments = parser.parse_args()
    if arguments.report is not None:
        print_table(json.loads(arguments.report.read_text("utf-8"))["cells"])
        return 0
    runs = arguments.runs.absolute()
    ways = {"stages": PIECES} | {piece: (piece,) * (PIECES.index(piece) + 1) for piece in TARGETS}
    chains = [
        Chain(name, pieces, seed, runs, arguments.steps)
        for name, pieces in ways.items()
        for seed in arguments.seeds
    ]
    anew = [
        dataclasses.replace(
            chain,
            name=f"{chain.pieces[number]}_anew",
            pieces=(chain.pieces[number],),
            start=chain.folder / f"{number}_{chain.pieces[number - 1]}",
        )
        for chain in chains
        if chain.name == "stages"
        for number in map(PIECES.index, TARGETS)
    ]
    found: dict[str, list[Metrics]] = {chain.name: [] for chain in (*chains, *anew)}
    try:
        with (
            stop_on_signal() as request,
            open_executor(arguments.workers, arguments.ray) as executor,
        ):
            for jobs in (chains, anew):  # the latter start from what the former have learnt
                for name, metrics in map_jobs(executor, trained, jobs, request):
                    found[name].append(metrics)
                    done, of = sum(map(len, found.values())), len(chains) + len(anew)
                    print(f"[{done}/{of}] {name}: finished", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    rows = rows_of(found)
    write_json(runs / "results.json", {"cells": rows})
    print_table(rows)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
