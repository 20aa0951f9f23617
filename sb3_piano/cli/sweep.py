"""``sb3-piano sweep``: train a grid of runs, on this machine or on a cluster."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sb3_piano.cli.common import (
    EXIT_OK,
    TRUST,
    add_row,
    command,
    new_table,
    print_table,
    progress_bar,
    tell_errors,
    tell_interrupted,
    whole_number,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sb3_piano.sweeps import CellResult

_RUN_HELP = "the sweep's folder; default: runs/sweeps/NAME, after FILE"
_RAY_HELP = "train on a cluster of Ray: the address that 'ray start --head' prints, auto, or ray://HOST:PORT"
_STORAGE_HELP = "keep the runs' folders there, such as s3://bucket/sweep; default: in the folder"
_METRICS = ("f1", "onset_f1", "return")


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _sweep, epilog=TRUST)
    add("file", "FILE", "YAML file of the grid; the same command goes on with it")
    add("--run", "FOLDER", _RUN_HELP)
    add("--workers", "N", "runs at once on this machine; default: one a core", whole_number)
    add("--ray", "ADDRESS", _RAY_HELP)
    add("--storage", "URL", _STORAGE_HELP)
    add("--status", text="say how far each run is, also while it is running, and end")
    add("--no-progress")


def _sweep(arguments: argparse.Namespace) -> int:
    from sb3_piano.sweeps import load_sweep, sweep, sweep_status

    config = load_sweep(arguments.file)
    folder = Path(arguments.run or Path("runs/sweeps", Path(arguments.file).stem))
    if arguments.status:
        _show(sweep_status(config, folder, arguments.storage))
        return EXIT_OK
    with progress_bar(arguments, "runs") as tell:

        def told(result: CellResult, done: int, total: int) -> None:
            tell(completed=done, total=total)
            print(f"[{done}/{total}] {result.name}, seed {result.seed}: {result.state}", flush=True)

        result = sweep(
            config,
            folder,
            workers=arguments.workers,
            ray=arguments.ray,
            runs=arguments.storage,
            on_result=told,
        )
    _show(result.cells)
    print(f"Results:  {result.folder / 'results.csv'}")
    if arguments.storage is None:
        print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(folder))}/*/seed_*")
    if result.interrupted:
        return tell_interrupted(True, hint=": the same command goes on.")
    failed = (f"{cell.name}, seed {cell.seed}: {cell.reason}" for cell in result.failures)
    return tell_errors(*failed)


def _show(cells: Sequence[CellResult]) -> None:
    table = new_table("cell", "seed", "state", "F1", "onset F1", "return", left=1)
    for cell in cells:
        numbers = [f"{cell.metrics[m]:.3f}" if m in cell.metrics else "" for m in _METRICS]
        add_row(table, cell.name, str(cell.seed), cell.state, *numbers)
    print_table(table)
