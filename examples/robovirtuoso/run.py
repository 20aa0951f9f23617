"""Train the cells of RoboVirtuoso's tables.

    python examples/robovirtuoso/run.py 'pretraining/*' 'table_1/*'   # some cells
    python examples/robovirtuoso/run.py 'table_3/*' --seeds 0 1       # with two seeds
    python examples/robovirtuoso/run.py --workers 2                   # all of them, two at once
    python examples/robovirtuoso/run.py --ray HOST:6379               # on a cluster, docs/sweeps.md

A training that is finished is skipped and one that was interrupted goes on, so that the same
command after Ctrl-C, or a crash, does the rest. What another cell starts from is trained before
it, or was, from the same seed. What is trained on several pieces is judged on unseen ones, too,
from beginning to end, and the sight-reader beside it. ``table.py`` prints what there is.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from cells import RUNS, SIGHT_READER, STUDY, Cell, Training, find_cells

from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import RunError, SB3PianoError
from sb3_piano.jobs import Outcome, finish
from sb3_piano.pipelines import TrainingJob
from sb3_piano.players import HandModel
from sb3_piano.players.hand_model import SHIPPED
from sb3_piano.training import EnvSpec, RunFolder
from sb3_piano.training.evaluation.evaluate import evaluate_runs


def main() -> int:
    """Run the cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("cells", nargs="*", default=["*"], help="names or patterns, such as 'table_3/*'")
    add("--seeds", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    add("--steps", type=int, metavar="N", help="default: those of the cell")
    add("--matmul-precision", metavar="HOW", help="highest (default), high or medium")
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="trainings at once; default: 1")
    where.add_argument("--ray", metavar="ADDRESS", help="train on a cluster that sees the runs")
    add("--no-progress", action="store_true", help="show no progress bar of one that is alone")
    arguments = parser.parse_args()
    workers = 1 if arguments.workers is None and arguments.ray is None else arguments.workers
    options = {"n_timesteps": arguments.steps, "matmul_precision": arguments.matmul_precision}
    changed = {name: value for name, value in options.items() if value is not None}
    bar = workers == 1 and not arguments.no_progress
    failed = 0
    try:
        cells = find_cells(arguments.cells)
        todo = [training for cell in cells for training in cell.trainings(arguments.seeds)]
        for wave in in_waves(todo):
            jobs = [job_of(training, arguments.runs, changed, bar) for training in wave]
            outcomes = finish(jobs, workers=workers, ray=arguments.ray, on_outcome=tell)
            failed += sum(outcome.error is not None for outcome in outcomes)
            for training, outcome in zip(wave, outcomes, strict=True):
                if outcome.result is not None:
                    steps = outcome.result["num_timesteps"]
                    judge(Cell(str(training.folder.parent)), outcome.job.folder, steps)
        if any(cell.is_together for cell in cells):
            judge_sight_reader(cells[0], arguments.runs / SIGHT_READER / "seed_0")
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    print(f"{len(todo) - failed} of {len(todo)} trainings are finished.")
    return 1 if failed else 0


def in_waves(todo: Sequence[Training]) -> Iterator[list[Training]]:
    """Yield trainings that may run at once: those first that others of them start from."""
    while todo:
        left = [training for training in todo if training.start in todo]
        yield [training for training in todo if training not in left]
        todo = left


def job_of(training: Training, runs: Path, changed: dict[str, Any], bar: bool) -> TrainingJob:
    """Return what brings a training to its end."""
    return TrainingJob(
        name=str(training.folder),
        folder=runs / training.folder,
        config=training.config(runs, **changed),
        progress_bar=bar,
    )


def tell(outcome: Outcome, done: int, total: int) -> None:
    """Say what became of a training."""
    found = outcome.reason or outcome.state
    print(f"[{done}/{total}] {outcome.job.name}: {found}", flush=True)


def judge(cell: Cell, folder: Path, steps: int) -> None:
    """Evaluate a run on each of its pieces, and on unseen ones, unless it was; say how it plays."""
    pieces: list[str] = []  # its own one
    if cell.is_together:
        pieces = [*RunFolder.open(folder).read_config().pieces, *STUDY["unseen"]]
    evaluate(folder, pieces, steps)


def judge_sight_reader(cell: Cell, folder: Path) -> None:
    """Evaluate the sight-reader on the unseen pieces, in the physics of a cell."""
    folder.mkdir(parents=True, exist_ok=True)
    steps = HandModel.load(SHIPPED).facts.num_timesteps
    options = {"physics": cell.settings.env_kwargs["physics"], "reduced_action_space": False}
    env = EnvSpec(id=GENERAL_ID, options=options)
    evaluate(folder, STUDY["unseen"], steps, SIGHT_READER, env=env)


def evaluate(
    folder: Path,
    pieces: Sequence[str],
    steps: int,
    player: str | None = None,
    **options: Any,
) -> None:
    """Evaluate a run, or a player, on pieces, or its own one; keep it as ``pieces.json``.

    What is kept already counts if the model had been trained for as many steps.
    """
    file = folder / "pieces.json"
    kept = json.loads(file.read_text("utf-8"))["evaluations"] if file.is_file() else []
    if kept and all(one["num_timesteps"] == steps for one in kept):
        return
    found = evaluate_runs([player or folder], scores=pieces, **options)
    if found.interrupted:
        raise KeyboardInterrupt
    if found.failures:
        raise RunError(f"{found.failures[0]} Nothing was kept: the same command judges it again.")
    found.write_json(file)
    scores = ", ".join(f"{each.piece} {each.mean['f1']:.3f}" for each in found.evaluations)
    print(f"{folder}: F1 {scores}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
