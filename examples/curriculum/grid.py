"""Hanon or nothing before a piece, with the finger labels shown or hidden, paid for or not.

    python examples/curriculum/grid.py                      # all cells, seeds 0 to 2
    python examples/curriculum/grid.py --before nothing --labels shown --fingering 0 0.1 0.3 1

The grid of section 4 of "Curriculum Strategies for Bimanual Dexterous Piano Playing in
RoboPianist", at a size for one core: 15,000 steps of each cell, four minutes, on the right hand's
29 notes of the Ode to Joy's first 16 s. What starts from Hanon had up to 45,000 steps of
practice.yml before, with the labels shown and paid for. What is finished is kept: the same command
goes on after Ctrl-C or a crash.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seeds import over_seeds

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Outcome, finish, map_jobs, open_executor
from sb3_piano.pipelines import TrainingJob, load_curriculum, run_curriculum
from sb3_piano.training import Plugin, RunConfig, load_config

HERE = Path(__file__).parent
PIECE = "RoboPianist-repertoire-OdeToJoy-v0"
BEFORE = ("nothing", "Hanon")
LABELS = ("shown", "hidden")
METRICS = ("onset_f1", "f1", "effective_fingers")


def main() -> int:
    """Train what is missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("--seeds", nargs="+", type=int, default=[0, 1, 2], metavar="N", help="default: 0 1 2")
    add("--before", nargs="+", default=BEFORE, choices=BEFORE, help="default: both")
    add("--labels", nargs="+", default=LABELS, choices=LABELS, help="default: both")
    add("--fingering", nargs="+", type=float, default=[0.0, 1.0], metavar="WEIGHT")
    add("--steps", type=int, metavar="N", help="of each stage and cell; default: theirs")
    add("--runs", type=Path, default=Path("runs/curriculum/grid"), metavar="DIR")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="trainings at once; default: one a core"
    )
    where.add_argument("--ray", metavar="ADDRESS", help="train on a cluster that sees the runs")
    arguments = parser.parse_args()
    runs, steps = arguments.runs.absolute(), arguments.steps
    cells = list(itertools.product(arguments.before, arguments.labels, arguments.fingering))
    try:
        with (
            stop_on_signal() as request,
            open_executor(arguments.workers, arguments.ray) as executor,
        ):
            seeds = arguments.seeds if "Hanon" in arguments.before else ()
            practice = [Practice(runs, seed, steps) for seed in seeds]
            starts = dict(map_jobs(executor, practised, practice, request))
            jobs = [
                TrainingJob(
                    name=f"{before}_{labels}_{weight:g}_seed_{seed}",
                    folder=runs / f"{before}_{labels}_{weight:g}_seed_{seed}",
                    config=cell(
                        labels, weight, starts[seed] if before == "Hanon" else None, seed, steps
                    ),
                )
                for before, labels, weight in cells
                for seed in arguments.seeds
            ]
            outcomes = finish(jobs, executor, on_outcome=tell)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    print("| before | labels | weight | onset F1 | F1 | fingers |")
    print("| --- | --- | --- | --- | --- | --- |")
    for before, labels, weight in cells:
        name = f"{before}_{labels}_{weight:g}"
        of_cell = [
            one.result["metrics"]
            for one in outcomes
            if one.result is not None and one.job.name.rpartition("_seed_")[0] == name
        ]
        columns = [over_seeds([mean[metric] for mean in of_cell]) for metric in METRICS]
        print(f"| {before} | {labels} | {weight:g} | {' | '.join(columns)} |")
    return 1 if any(one.error is not None for one in outcomes) else 0


def tell(outcome: Outcome, done: int, total: int) -> None:
    """Say what became of a run."""
    found = outcome.reason or outcome.state
    print(f"[{done}/{total}] {outcome.job.name}: {found}", file=sys.stderr)


@dataclass(frozen=True)
class Practice:
    """Hanon's exercises from a seed."""

    runs: Path
    seed: int
    steps: int | None


def practised(practice: Practice) -> tuple[int, Path]:
    """Train what is missing of practice; return its seed and the run of its last stage.

    Raises:
        KeyboardInterrupt: If it was interrupted; the next call goes on.
    """
    curriculum = load_curriculum(HERE / "practice.yml")
    curriculum = dataclasses.replace(curriculum, seed=practice.seed)
    if practice.steps is not None:
        changed = {"n_timesteps": practice.steps}
        stages = [
            dataclasses.replace(stage, until=None, settings={**stage.settings, **changed})
            for stage in curriculum.stages
        ]
        curriculum = dataclasses.replace(curriculum, stages=tuple(stages))
    folder = practice.runs / f"practice_seed_{practice.seed}"
    *_, last = run_curriculum(curriculum, folder, progress_bar=False)
    if last.result is None:
        raise KeyboardInterrupt
    return practice.seed, last.job.folder


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
