"""A sweep: a job for each run of a grid, in one folder."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.exceptions import RunError
from sb3_piano.files import load_yaml, write_csv, write_yaml
from sb3_piano.jobs import Outcome, Resources, finish, is_empty, status
from sb3_piano.jobs.folders import shared_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.pipelines.grid import SweepConfig
from sb3_piano.pipelines.training import TrainingJob, training

RESULTS = "results.csv"

_FORMER = "sweep.yml"
"""File in which former versions noted the settings of all runs."""


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """What a sweep came to."""

    folder: Path
    """The sweep's folder."""
    runs: tuple[Outcome, ...]
    """Each run, in the order of the grid."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def failures(self) -> list[Outcome]:
        """The runs that failed."""
        return [run for run in self.runs if run.error is not None]


def sweep(
    config: SweepConfig,
    folder: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    ray: str | None = None,
    on_result: Callable[[Outcome, int, int], object] = lambda outcome, done, total: None,
) -> SweepResult:
    """Train and evaluate every run of a grid, or go on with what is left of one.

    The folder gets a run's folder ``<cell>/seed_<n>`` for each, and ``results.csv``, a line of
    each. A run that is finished is left as it is, one that stopped goes on from its last
    checkpoint, and one that fails does not stop the others. Ctrl-C ends it; the same call goes on.

    Args:
        config: The grid.
        folder: The sweep's folder, new, empty or that of a sweep of the same settings; cells and
            seeds may have been added.
        executor: Where the runs are trained; by default what ``workers`` and ``ray`` say, see
            :func:`~sb3_piano.jobs.open_executor`.
        workers: Processes on this machine.
        ray: Address of a cluster of Ray, all of whose nodes see the folder.
        on_result: Is called with each run that came to an end, and how many of how many did.

    Raises:
        ConfigError: If a setting is not valid, or the cluster cannot be reached.
        RunError: If the folder cannot be used, or has runs of other settings.
    """
    place = shared_folder(folder)
    jobs = jobs_of(config, place)
    expected = "one command in a folder. More runs at once are --workers; how far it is: sb3-piano "
    expected += "sweep FILE --status"
    with hold(place / LOCK_SUFFIX, f"Sweep '{place}' is being run", expected):
        _begin(place, jobs)
        known = status(jobs)
        found = {one.job.name: one for one in known}

        def tell(outcome: Outcome, done: int, total: int) -> None:
            found[outcome.job.name] = outcome
            write_results(place, list(found.values()))
            on_result(outcome, done, total)

        interrupted = False
        try:
            finish(
                jobs,
                executor,
                workers=workers,
                ray=ray,
                resources=Resources(**config.resources),
                known=known,
                on_outcome=tell,
            )
        except KeyboardInterrupt:
            interrupted = True
        write_results(place, list(found.values()))
    return SweepResult(folder=place, runs=tuple(found.values()), interrupted=interrupted)


def sweep_status(config: SweepConfig, folder: str | os.PathLike[str]) -> list[Outcome]:
    """Return how far each run of a sweep is, also while it is running."""
    return status(jobs_of(config, shared_folder(folder)))


def jobs_of(config: SweepConfig, place: Path) -> list[TrainingJob]:
    """Return the runs of a sweep in its folder."""
    return [
        training(
            f"{cell}/seed_{seed}",
            place / cell / f"seed_{seed}",
            run,
            episodes=config.episodes,
            checkpoint_every=config.checkpoint_every,
        )
        for (cell, seed), run in config.runs().items()
    ]


def write_results(place: Path, runs: Sequence[Outcome]) -> None:
    """Write a line of each run: what it is called, how far it is, and its metrics."""
    rows: list[dict[str, Any]] = []
    names: dict[str, Any] = {}
    for run in runs:
        cell, _, seed = run.job.name.rpartition("/seed_")
        row = {"cell": cell, "seed": seed, "state": run.state}
        steps = (run.job.progress() or (0,))[0]
        metrics = (run.result or {}).get("metrics", {})
        names |= metrics
        rows.append(
            {**row, "steps": steps, "reason": run.reason, "folder": run.job.folder, **metrics}
        )
    columns = ("cell", "seed", "state", "steps", *names, "reason", "folder")
    write_csv(place / RESULTS, columns, rows)


def _begin(place: Path, jobs: Sequence[TrainingJob]) -> None:
    """Begin a folder, or go on in that of a sweep, which may be of a former version."""
    former = place / _FORMER
    if former.is_file():
        noted = load_yaml(former.read_text("utf-8")) or {}
        for job in jobs:
            if job.name in noted and job.folder.is_dir() and not job.settings_file.is_file():
                write_yaml(job.settings_file, noted[job.name])
    elif not (place / RESULTS).is_file() and not is_empty(place):
        raise RunError(f"Folder '{place}' is not empty and no sweep: expected a new or empty one.")
    write_results(place, status(jobs))
