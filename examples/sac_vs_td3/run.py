"""Train the cells of the paper's tables, one after the other, and say how well each plays.

    python examples/sac_vs_td3/run.py td3/d_major sac/d_major   # some cells
    python examples/sac_vs_td3/run.py '*/c_major*' --seeds 0 1  # by pattern, with two seeds
    python examples/sac_vs_td3/run.py                           # all of them: a day

A cell that is finished is skipped and one that was interrupted goes on, so that the same command
after Ctrl-C, or a crash, does the rest. ``table.py`` prints what there is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cells import RUNS, find_cells

from sb3_piano.exceptions import SB3PianoError
from sb3_piano.training import RunConfig, evaluate, resume, train


def main() -> int:
    """Run the cells that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add = parser.add_argument
    add("cells", nargs="*", default=["*"], help="names or patterns, such as 'td3/*'; default: all")
    add("--seeds", nargs="+", type=int, default=[0], metavar="N", help="default: 0")
    add("--steps", type=int, metavar="N", help="default: 50000, the paper's")
    add("--matmul-precision", metavar="HOW", help="highest (default), high or medium")
    add("--runs", type=Path, default=RUNS, metavar="DIR", help=f"default: {RUNS}")
    add("--no-progress", action="store_true", help="show no progress bar")
    arguments = parser.parse_args()
    try:
        changed = {"n_timesteps": arguments.steps, "matmul_precision": arguments.matmul_precision}
        changed = {name: value for name, value in changed.items() if value is not None}
        todo = [(cell, seed) for seed in arguments.seeds for cell in find_cells(arguments.cells)]
        for number, (cell, seed) in enumerate(todo, start=1):
            print(f"[{number}/{len(todo)}] {cell.name}, seed {seed}", flush=True)
            folder = cell.run_folder(arguments.runs, seed)
            if not run_cell(cell.config(seed, **changed), folder, not arguments.no_progress):
                print("Interrupted: the same command goes on from here.")
                return 130
    except SB3PianoError as error:
        parser.exit(2, f"{parser.prog}: error: {error}\n")
    return 0


def run_cell(config: RunConfig, folder: Path, progress: bool) -> bool:
    """Bring the run of a cell to its end and evaluate it.

    Returns:
        Whether it came to its end, rather than being interrupted.
    """
    if (folder / "config.yml").is_file():
        result = resume(folder, config.n_timesteps, progress_bar=progress)
    else:
        result = train(config, folder, progress_bar=progress)
    if result.interrupted:
        return False
    if result.had_finished and (folder / "evaluation" / "metrics.json").is_file():
        print("  finished before")
        return True
    mean = evaluate(folder).mean
    print(f"  return {mean['return']:.2f}, F1 {mean['f1']:.3f}: {folder}", flush=True)
    return True


if __name__ == "__main__":
    raise SystemExit(main())
