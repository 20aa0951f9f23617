"""``sb3-piano sweep``: train a grid of runs on this machine or a cluster."""

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
    print_errors,
    print_interrupted,
    print_narrowness,
    print_table,
    progress_bar,
    whole_number,
)
from sb3_piano.exceptions import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sb3_piano.jobs import Outcome

_OUT_HELP = "folder of the sweep; default: runs/sweeps/NAME, after FILE"
_RAY_HELP = "train on a Ray cluster: the address from 'ray start --head', auto, or ray://HOST:PORT"
_METRICS = ("f1", "onset_f1", "return")


def add_arguments(parser: Any) -> None:
    """Add the arguments of the command."""
    add = command(parser, _sweep, epilog=TRUST)
    add("file", "FILE", "YAML file of the grid; the same command resumes it")
    add("--out", "FOLDER", _OUT_HELP)
    add("--workers", "N", "parallel runs on this machine; default: one per core", whole_number)
    add("--ray", "ADDRESS", _RAY_HELP)
    add("--storage", "URL", argparse.SUPPRESS)  # deprecated
    add("--status", text="print the state of each run, also while it trains, and exit")
    add("--no-progress")


def _sweep(arguments: argparse.Namespace) -> int:
    from sb3_piano.jobs import status
    from sb3_piano.jobs.folders import shared_folder
    from sb3_piano.pipelines import load_sweep, sweep

    if (given := Path(arguments.file)).is_dir():
        out = shlex.quote(arguments.file)
        raise ConfigError(
            f"'{given}' is a folder: expected its sweep's YAML file, and --out {out}."
        )
    config = load_sweep(arguments.file)
    default = Path("runs/sweeps", Path(arguments.file).stem)
    for url in filter(None, (arguments.out, arguments.storage)):
        shared_folder(url)
    folder = Path(arguments.out or default)
    if arguments.status:
        _show(status(config.jobs(folder)))
        return EXIT_OK
    with progress_bar(arguments, "runs") as tell:

        def report(outcome: Outcome, done: int, total: int) -> None:
            tell(completed=done, total=total)
            print(f"[{done}/{total}] {_called(outcome)}: {outcome.state}", flush=True)

        runs = sweep(
            config,
            folder,
            workers=arguments.workers,
            ray=arguments.ray,
            on_result=report,
        )
    _show(runs)
    print(f"Results:  {folder.absolute() / 'results.csv'}")
    print(f"Evaluate: sb3-piano evaluate {shlex.quote(str(folder))}/*/seed_*")
    if any(run.result is None and run.error is None for run in runs):
        return print_interrupted(True, hint=": the same command resumes it.")
    failed = (f"{_called(run)}: {run.reason}" for run in runs if run.error is not None)
    return print_errors(*failed)


def _called(run: Outcome) -> str:
    return run.job.name.replace("/seed_", ", seed ")


def _show(runs: Sequence[Outcome]) -> None:
    """Print a row for each run, and the means of cells with several seeds."""
    table = new_table("cell", "seed", "state", "F1", "onset F1", "return", left=1)
    cells: dict[str, list[Mapping[str, float]]] = {}
    for run in runs:
        metrics = (run.result or {}).get("metrics", {})
        numbers = [f"{metrics[m]:.3f}" if m in metrics else "" for m in _METRICS]
        cell, _, seed = run.job.name.rpartition("/seed_")
        add_row(table, cell, seed, run.state, *numbers)
        cells.setdefault(cell, []).extend([metrics] if metrics else [])
    several = {cell: found for cell, found in cells.items() if len(found) > 1}
    if several:
        table.add_section()
    for cell, found in several.items():
        add_row(table, cell, f"all {len(found)}", "mean", *(_mean(found, m) for m in _METRICS))
    print_table(table)
    if several:
        print_narrowness(min(map(len, several.values())))


def _mean(found: Sequence[Mapping[str, float]], metric: str) -> str:
    """Return the mean of a metric over seeds, and its 95 % interval below it."""
    from sb3_piano.training.evaluation.statistics import summarize

    values = [metrics[metric] for metrics in found if metric in metrics]
    if not values:
        return ""
    summary = summarize(values)
    ends = "" if summary.interval is None else "\n{:.3f}..{:.3f}".format(*summary.interval)
    return f"{summary.mean:.3f}{ends}"
