"""Train the cells of RoboVirtuoso's tables, one training after the other.

    python examples/robovirtuoso/run.py 'pretraining/*' 'table_1/*'   # some cells
    python examples/robovirtuoso/run.py 'table_3/*' --seeds 0 1       # with two seeds
    python examples/robovirtuoso/run.py                               # all of them

A training that is finished is skipped and one that was interrupted goes on, so that the same
command after Ctrl-C, or a crash, does the rest. What another cell starts from has to be trained
first, from the same seed. ``table.py`` prints what there is.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cells import RUNS, Training, find_cells

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.training import evaluate_runs, resume, train


def main() -> int:
    """Run the cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("cells", nargs="*", default=["*"], help="names or patterns, such as 'table_3/*'")
    add("--seeds", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    add("--steps", type=int, metavar="N", help="default: those of the cell")
    add("--matmul-precision", metavar="HOW", help="highest (default), high or medium")
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    add("--no-progress", action="store_true", help="show no progress bar")
    arguments = parser.parse_args()
    options = {"n_timesteps": arguments.steps, "matmul_precision": arguments.matmul_precision}
    changed = {name: value for name, value in options.items() if value is not None}
    try:
        cells = find_cells(arguments.cells)
        todo = [training for cell in cells for training in cell.trainings(arguments.seeds)]
        for number, training in enumerate(todo, start=1):
            print(f"[{number}/{len(todo)}] {training.folder}", flush=True)
            if not finish(training, arguments.runs, changed, not arguments.no_progress):
                print("Interrupted: the same command goes on from here.")
                return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def finish(training: Training, runs: Path, changed: dict[str, Any], progress: bool) -> bool:
    """Bring a training to its end and evaluate it on each of its pieces.

    Returns:
        Whether it came to its end, rather than being interrupted.
    """
    config, folder = training.config(runs, **changed), runs / training.folder
    evaluation = folder / "pieces.json"
    if (folder / "config.yml").is_file():
        result = resume(folder, config.n_timesteps, progress_bar=progress)
    else:
        result = train(config, folder, progress_bar=progress)
    if result.interrupted:
        return False
    if result.had_finished and evaluation.is_file():
        print("  finished before")
        return True
    found = evaluate_runs([folder])
    found.write_json(evaluation)
    scores = ", ".join(f"{each.piece} {each.mean['f1']:.3f}" for each in found.evaluations)
    print(f"  F1 {scores}", flush=True)
    return not found.interrupted


if __name__ == "__main__":
    raise SystemExit(main())
