"""Train the cells of the paper's tables, and say how well each plays.

    python examples/sac_vs_td3/run.py td3/d_major sac/d_major   # some cells
    python examples/sac_vs_td3/run.py '*/c_major*' --seeds 0 1  # by pattern, with two seeds
    python examples/sac_vs_td3/run.py --workers 2               # all of them, two at once: a day
    python examples/sac_vs_td3/run.py --ray HOST:6379           # on a cluster, see docs/sweeps.md

A cell that is finished is skipped and one that was interrupted goes on, so that the same command
after Ctrl-C, or a crash, does the rest. ``table.py`` prints what there is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cells import RUNS, find_cells

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.jobs import Outcome, finish
from sb3_piano.pipelines import TrainingJob


def main() -> int:
    """Run the cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("cells", nargs="*", default=["*"], help="names or patterns, such as 'td3/*'; default: all")
    add("--seeds", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    add("--steps", type=int, metavar="N", help="default: 50000, the paper's")
    add("--matmul-precision", metavar="HOW", help="highest (default), high or medium")
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="N", help="runs at once; default: 1")
    where.add_argument("--ray", metavar="ADDRESS", help="train on a cluster that sees the runs")
    add("--no-progress", action="store_true", help="show no progress bar of a run that is alone")
    arguments = parser.parse_args()
    workers = 1 if arguments.workers is None and arguments.ray is None else arguments.workers
    changed = {"n_timesteps": arguments.steps, "matmul_precision": arguments.matmul_precision}
    changed = {name: value for name, value in changed.items() if value is not None}
    try:
        jobs = [
            TrainingJob(
                name=f"{cell.name}, seed {seed}",
                folder=cell.run_folder(arguments.runs, seed),
                config=cell.config(seed, **changed),
                progress_bar=workers == 1 and not arguments.no_progress,
            )
            for seed in arguments.seeds
            for cell in find_cells(arguments.cells)
        ]
        outcomes = finish(jobs, workers=workers, ray=arguments.ray, on_outcome=tell)
    except KeyboardInterrupt:
        print("Interrupted: the same command goes on from here.")
        return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    failed = [outcome for outcome in outcomes if outcome.error is not None]
    print(f"{len(outcomes) - len(failed)} of {len(outcomes)} runs are finished.")
    return 1 if failed else 0


def tell(outcome: Outcome, done: int, total: int) -> None:
    """Say what became of a run."""
    found = outcome.reason
    if outcome.result is not None:
        mean = outcome.result["metrics"]
        found = f"return {mean['return']:.2f}, F1 {mean['f1']:.3f}"
    print(f"[{done}/{total}] {outcome.job.name}: {found}: {outcome.job.folder}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
