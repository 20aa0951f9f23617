"""A sweep in its folder: begun, gone on with, and its results."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from sb3_piano.exceptions import RunError
from sb3_piano.files import dump_yaml, load_yaml, read_table, write_csv, write_yaml
from sb3_piano.jobs import Resources
from sb3_piano.jobs.folders import is_empty
from sb3_piano.links import keep_inside
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.sweeps.cells import CellJob, CellResult, finish_cells, status_of
from sb3_piano.sweeps.config import SweepConfig
from sb3_piano.training import RunConfig

RESULTS = "results.csv"
_CONFIG = "sweep.yml"


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """What a sweep came to."""

    folder: Path
    """The sweep's folder."""
    cells: tuple[CellResult, ...]
    """Each run, in the order of the grid."""
    interrupted: bool = False
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def failures(self) -> list[CellResult]:
        """The runs that failed."""
        return [cell for cell in self.cells if cell.error is not None]


def sweep(
    config: SweepConfig,
    folder: str | os.PathLike[str],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    ray: str | None = None,
    runs: str | None = None,
    on_result: Callable[[CellResult, int, int], object] = lambda result, done, total: None,
) -> SweepResult:
    """Train and evaluate every run of a grid, or go on with what is left of one.

    The folder gets ``sweep.yml``, the settings; a run's folder ``<cell>/seed_<n>`` for each, unless
    ``runs`` says otherwise; and ``results.csv``, a line of each run. A run that is finished is left
    as it is, one that stopped goes on from its last checkpoint, and one that fails does not stop
    the others. Ctrl-C ends it; the same call goes on.

    Args:
        config: The grid.
        folder: The sweep's folder, new, empty or that of a sweep of the same settings; cells and
            seeds may have been added.
        executor: Where the runs are trained; by default what ``workers`` and ``ray`` say, see
            :func:`~sb3_piano.jobs.open_executor`.
        workers: Processes on this machine.
        ray: Address of a cluster of Ray, all of whose nodes see the folder, or ``runs``.
        runs: Where the runs are, if not in the folder: a URL as of fsspec.
        on_result: Is called with each run that came to an end, and how many of how many did.

    Raises:
        ConfigError: If a setting is not valid, or the cluster cannot be reached.
        RunError: If the folder cannot be used, or has a sweep of other settings.
    """
    place = Path(folder).absolute()
    keep_inside(place)
    jobs = jobs_of(config, place, runs)
    expected = "one command in a folder. More runs at once are --workers; how far it is: sb3-piano "
    expected += "sweep FILE --status"
    with hold(place / LOCK_SUFFIX, f"Sweep '{place}' is being run", expected):
        _begin(place, {(job.name, job.config.seed or 0): job.config for job in jobs})
        ended = {job.folder: status_of(job) for job in jobs}

        def tell(result: CellResult, done: int, total: int) -> None:
            ended[result.folder] = result
            write_results(place, list(ended.values()))
            on_result(result, done, total)

        interrupted = False
        try:
            finish_cells(
                jobs,
                before=list(ended.values()),
                executor=executor,
                workers=workers,
                ray=ray,
                resources=Resources(**config.resources),
                on_result=tell,
            )
        except KeyboardInterrupt:
            interrupted = True
            ended |= {job.folder: status_of(job) for job in jobs if not ended[job.folder].error}
        results = tuple(ended.values())
        write_results(place, results)
    return SweepResult(folder=place, cells=results, interrupted=interrupted)


def sweep_status(
    config: SweepConfig, folder: str | os.PathLike[str], runs: str | None = None
) -> list[CellResult]:
    """Return how far each run of a sweep is, also while it is running."""
    return [status_of(job) for job in jobs_of(config, Path(folder).absolute(), runs)]


def jobs_of(config: SweepConfig, place: Path, runs: str | None = None) -> list[CellJob]:
    """Return the runs of a sweep in its folder."""
    root = str(place) if runs is None else runs.rstrip("/")
    return [
        CellJob(
            name=name,
            config=run,
            folder=f"{root}/{name}/seed_{seed}",
            episodes=config.episodes,
            checkpoint_every=config.checkpoint_every,
        )
        for (name, seed), run in config.runs().items()
    ]


def write_results(place: Path, results: Sequence[CellResult]) -> None:
    """Write a line of each run: what it is called, how far it is, and its metrics."""
    metrics = dict.fromkeys(name for result in results for name in result.metrics)
    rows = [
        {
            "cell": result.name,
            "seed": result.seed,
            "state": result.state,
            "steps": result.num_timesteps,
            "reason": result.reason,
            "folder": result.folder,
            **result.metrics,
        }
        for result in results
    ]
    columns = ("cell", "seed", "state", "steps", *metrics, "reason", "folder")
    write_csv(place / RESULTS, columns, rows)


def _begin(place: Path, runs: dict[tuple[str, int], RunConfig]) -> None:
    """Note the settings of the runs, or refuse others than those that are noted."""
    file = place / _CONFIG
    now = {f"{name}/seed_{seed}": run.to_mapping() for (name, seed), run in runs.items()}
    noted: dict[str, object] = {}
    if file.is_file():
        noted = read_table(file) or {}
        for name, mapping in now.items():
            if name in noted and noted[name] != load_yaml(dump_yaml(mapping)):
                raise RunError(
                    f"Run {name!r} of the sweep in '{place}' has other settings than when it was "
                    f"begun ({_difference(noted[name], mapping)}): expected the same, or another "
                    f"folder. What it had: {shlex.quote(str(file))}"
                )
    elif not is_empty(place):
        raise RunError(f"Folder '{place}' is not empty and no sweep: expected a new or empty one.")
    write_yaml(file, {**noted, **now})


def _difference(noted: object, now: dict[str, object]) -> str:
    """Return the first setting that differs."""
    before = noted if isinstance(noted, dict) else {}
    plain = load_yaml(dump_yaml(now))
    for name in dict.fromkeys([*before, *plain]):
        if before.get(name) != plain.get(name):
            return f"{name} was {before.get(name)!r} and is {plain.get(name)!r}"
    return "their order"
