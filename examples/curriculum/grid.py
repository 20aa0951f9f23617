"""Hanon or nothing before a piece, with the finger labels shown or hidden, paid for or not.

    python examples/curriculum/grid.py                      # all cells, seeds 0 to 2
    python examples/curriculum/grid.py --fingering 0 --seeds 0

The grid of section 4 of "Curriculum Strategies for Bimanual Dexterous Piano Playing in
RoboPianist", at a size for one core: 15,000 steps of each cell, four minutes, on the right hand's
30 notes of the Ode to Joy's first 16 s. What starts from Hanon had up to 45,000 steps of
practice.yml before, with the labels shown and paid for. Practice is trained in this process, cells
at once with --workers, or on a cluster of Ray with --ray, which has to see the runs. What is
finished is kept: the same command goes on after Ctrl-C or a crash.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
from pathlib import Path
from typing import Any

from seeds import over_seeds

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.sweeps import CellJob, CellResult, finish_cells
from sb3_piano.training import (
    Plugin,
    RunConfig,
    load_config,
    load_curriculum,
    run_curriculum,
)

HERE = Path(__file__).parent
PIECE = "RoboPianist-repertoire-OdeToJoy-v0"
BEFORE = ("nothing", "Hanon")
METRICS = ("onset_f1", "f1", "effective_fingers")


def main() -> int:
    """Train what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--fingering", nargs="+", type=float, default=[0.0, 1.0], metavar="WEIGHT")
    add("--steps", type=int, metavar="N", help="of each stage and cell; default: theirs")
    add("--runs", type=Path, default=Path("runs/curriculum/grid"), metavar="DIR")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="cells at once; default: one a core"
    )
    where.add_argument("--ray", metavar="ADDRESS", help="train on a cluster that sees the runs")
    arguments = parser.parse_args()
    cells = list(itertools.product(BEFORE, ("shown", "hidden"), arguments.fingering))
    try:
        practice = {
            ("Hanon", seed): practised(seed, arguments).absolute() for seed in arguments.seeds
        }
        jobs = [
            CellJob(
                name=f"{before}_{labels}_{weight:g}",
                config=cell(labels, weight, practice.get((before, seed)), seed, arguments.steps),
                folder=str(
                    (arguments.runs / f"{before}_{labels}_{weight:g}_seed_{seed}").absolute()
                ),
            )
            for before, labels, weight in cells
            for seed in arguments.seeds
        ]
        results = finish_cells(jobs, workers=arguments.workers, ray=arguments.ray, on_result=tell)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    print("| before | labels | weight | onset F1 | F1 | fingers |")
    print("| --- | --- | --- | --- | --- | --- |")
    for before, labels, weight in cells:
        name = f"{before}_{labels}_{weight:g}"
        of_cell = [result.metrics for result in results if result.name == name and result.finished]
        columns = [over_seeds([mean[metric] for mean in of_cell]) for metric in METRICS]
        print(f"| {before} | {labels} | {weight:g} | {' | '.join(columns)} |")
    return 1 if any(result.error is not None for result in results) else 0


def tell(result: CellResult, done: int, total: int) -> None:
    """Say what became of a run."""
    found = result.reason or result.state
    print(f"[{done}/{total}] {result.name}, seed {result.seed}: {found}", file=sys.stderr)


def practised(seed: int, arguments: argparse.Namespace) -> Path:
    """Return the folder of the last stage of practice, after training what is missing of it."""
    curriculum = load_curriculum(HERE / "practice.yml")
    if arguments.steps is not None:
        stages = [
            dataclasses.replace(
                stage, until=None, settings={**stage.settings, "n_timesteps": arguments.steps}
            )
            for stage in curriculum.stages
        ]
        curriculum = dataclasses.replace(curriculum, stages=tuple(stages))
    result = run_curriculum(curriculum, arguments.runs / f"practice_seed_{seed}", seed=seed)
    if result.interrupted:
        raise KeyboardInterrupt
    return result.runs[-1].path


def cell(labels: str, weight: float, start: Path | None, seed: int, steps: int | None) -> RunConfig:
    """Return the settings of a cell."""
    options = {} if steps is None else {"n_timesteps": steps}
    config = load_config("sac", PIECE, HERE / "grid.yml", seed=seed, **options)
    wrappers = list(config.env_wrapper)
    if labels == "hidden":
        wrappers.append(Plugin(path="sb3_piano.wrappers.HideFingering"))
    callbacks = list(config.callback)
    if start is not None:
        path = "sb3_piano.training.StartFromRun"
        callbacks.append(Plugin(path=path, kwargs={"run": str(start.absolute())}))
    changed: dict[str, Any] = {
        "env_kwargs": {**config.env_kwargs, "reward_weights": {"fingering": weight}},
        "env_wrapper": tuple(wrappers),
        "callback": tuple(callbacks),
    }
    return dataclasses.replace(config, **changed)


if __name__ == "__main__":
    raise SystemExit(main())
