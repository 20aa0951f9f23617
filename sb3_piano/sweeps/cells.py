"""Cells: runs that are brought to their end wherever they are, from wherever they stopped."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sb3_piano.callbacks.checkpoint import DEFAULT_EVERY
from sb3_piano.exceptions import SB3PianoError
from sb3_piano.files import read_json, write_json
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Resources, broken_told, map_jobs, open_executor
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.sweeps.storage import Mirror, glance, mirrored
from sb3_piano.training import RunConfig, RunFolder, evaluate, resume, train

_SAVED, _EVALUATION = "checkpoint/checkpoint.json", "evaluation/metrics.json"
_ENDED = "ended.json"
"""Where a run notes that a callback has ended its training before all steps were done."""


@dataclass(frozen=True, kw_only=True)
class CellJob:
    """A run that is to be trained to its end and evaluated."""

    name: str
    """What it is called."""
    config: RunConfig
    """Its settings, with a seed."""
    folder: str
    """The run's folder: a path that every node sees, or a URL as of fsspec."""
    episodes: int = 1
    """Episodes of each of its pieces that the trained model plays."""
    checkpoint_every: int = DEFAULT_EVERY
    """Environment steps between two checkpoints."""
    progress_bar: bool = False
    """Whether the worker shows a bar of its steps."""


@dataclass(frozen=True, kw_only=True)
class CellResult:
    """What became of a run."""

    name: str
    """What it is called."""
    seed: int
    """Seed of its training."""
    folder: str
    """The run's folder."""
    started_at: int = 0
    """Environment steps that were done before this attempt."""
    num_timesteps: int = 0
    """Environment steps that are done."""
    n_timesteps: int = 0
    """Environment steps that were asked for."""
    metrics: Mapping[str, float] = field(default_factory=dict)
    """Means over the episodes of the trained model; empty unless it is finished."""
    error: str | None = None
    """Why it failed; ``None`` if it did not."""

    @property
    def finished(self) -> bool:
        """Whether it is trained and evaluated."""
        return bool(self.metrics)

    @property
    def reason(self) -> str:
        """Why it failed, in a line; empty if it did not."""
        return "" if self.error is None else self.error.strip().splitlines()[-1]

    @property
    def state(self) -> str:
        """``finished``, ``failed``, how far it is, or ``not begun``."""
        if self.error is not None:
            return "failed"
        if self.finished:
            return "finished"
        steps = f"{self.num_timesteps} of {self.n_timesteps} steps"
        return steps if self.num_timesteps else "not begun"


@dataclass(frozen=True, kw_only=True)
class _Saved:
    """What is of interest in a checkpoint."""

    num_timesteps: int


@dataclass(frozen=True, kw_only=True)
class _Ended:
    """The end of a training before all its steps were done."""

    num_timesteps: int
    n_timesteps: int


@dataclass(frozen=True, kw_only=True)
class _Judged:
    """What is of interest in an evaluation."""

    num_timesteps: int
    interrupted: bool
    env_kwargs: Mapping[str, Any]
    episodes: Sequence[Any]
    mean: Mapping[str, Any]
    evaluations: Sequence[Any] = ()


def finish_cells(
    jobs: Sequence[CellJob],
    *,
    before: Sequence[CellResult] | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
    on_result: Callable[[CellResult, int, int], object] = lambda result, done, total: None,
) -> list[CellResult]:
    """Bring runs to their end; return what became of each, in their order.

    A run that is finished is left as it is, one that had stopped goes on from its last checkpoint,
    and one that fails does not stop the others. Ctrl-C and SIGTERM end it; the same call goes on.

    Args:
        jobs: The runs, whose folders differ.
        before: How far each is, if that is known already.
        executor: Where they are trained; by default what the next three say, see
            :func:`~sb3_piano.jobs.open_executor`.
        workers: Processes on this machine.
        ray: Address of a cluster of Ray, all of whose nodes see the folders.
        resources: What a run needs, on a cluster.
        on_result: Is called with each run that came to an end, and how many of how many did.

    Raises:
        KeyboardInterrupt: If it was interrupted.
        RunError: If a worker was killed.
    """
    ended = {result.folder: result for result in before or map(status_of, jobs)}
    todo = [job for job in jobs if not ended[job.folder].finished]
    chosen = (
        open_executor(workers, ray, resources)
        if executor is None
        else contextlib.nullcontext(executor)
    )
    if todo:
        with (
            stop_on_signal() as request,
            chosen as opened,
            broken_told("give the same command again."),
            contextlib.closing(map_jobs(opened, finish_cell, todo, request)) as results,
        ):
            for result in results:
                ended[result.folder] = result
                done = sum(one.finished or one.error is not None for one in ended.values())
                on_result(result, done, len(jobs))
    return [ended[job.folder] for job in jobs]


def status_of(job: CellJob) -> CellResult:
    """Return how far a run is by its folder, also while it is trained."""
    assert job.config.seed is not None, "cells have seeds"
    total = job.config.n_timesteps
    known: dict[str, Any] = {"name": job.name, "seed": job.config.seed, "folder": job.folder}
    with glance(job.folder, (_SAVED, _EVALUATION, _ENDED)) as place:
        steps = _steps(place)
        over = _is_over(place, steps, total)
        metrics = metrics_of(place, job.config, steps, job.episodes) if over else {}
    return CellResult(
        **known, started_at=steps, num_timesteps=steps, n_timesteps=total, metrics=metrics
    )


def _steps(place: Path) -> int:
    saved = read_json(place / _SAVED, _Saved, "expected a checkpoint.")
    return 0 if saved is None else saved.num_timesteps


def _is_over(place: Path, steps: int, total: int) -> bool:
    """Return whether a training that was to have ``total`` steps is over after ``steps``."""
    ended = read_json(place / _ENDED, _Ended, "expected what a sweep writes.")
    return steps >= total or ended == _Ended(num_timesteps=steps, n_timesteps=total)


def finish_cell(job: CellJob) -> CellResult:
    """Train a run to its end, from its last checkpoint if there is one, and evaluate it.

    Raises:
        KeyboardInterrupt: If it was interrupted, and has saved a checkpoint.
    """
    assert job.config.seed is not None, "cells have seeds"
    known: dict[str, Any] = {"name": job.name, "seed": job.config.seed, "folder": job.folder}
    try:
        with mirrored(job.folder) as mirror, hold(_lock(mirror.place)):
            return CellResult(**known, **_finished(job, mirror))
    except SB3PianoError as error:
        return CellResult(**known, error=str(error))
    except Exception:  # a run's own wrappers may fail in any way
        return CellResult(**known, error=traceback.format_exc())


def _finished(job: CellJob, mirror: Mirror) -> dict[str, Any]:
    place, config = mirror.place, job.config
    options: dict[str, Any] = {
        "progress_bar": job.progress_bar,
        "checkpoint_every": job.checkpoint_every,
        "callbacks": mirror.callbacks,
    }
    started_at, total = _steps(place), config.n_timesteps
    done = started_at
    if not _is_over(place, started_at, total):
        if RunFolder(place).has_begun:
            trained = resume(place, total, **options)
        else:
            trained = train(config, place, **options)
        if trained.interrupted:
            mirror.store()
            raise KeyboardInterrupt
        started_at, done = trained.started_at, trained.num_timesteps
        if done < total:
            write_json(place / _ENDED, asdict(_Ended(num_timesteps=done, n_timesteps=total)))
    steps = {"started_at": started_at, "num_timesteps": done, "n_timesteps": total}
    metrics = metrics_of(place, config, done, job.episodes)
    if not metrics:
        found = evaluate(place, job.episodes)
        if found.interrupted:
            mirror.store()
            raise KeyboardInterrupt
        metrics = found.mean
    mirror.store()
    return {**steps, "metrics": metrics}


def metrics_of(place: Path, config: RunConfig, steps: int, episodes: int) -> dict[str, float]:
    """Return the means of a run's evaluation; nothing if it has none after so many steps.

    Args:
        place: The run's folder.
        config: Its settings: an evaluation in other physics than its own is none of it.
        steps: Environment steps that the model was trained for.
        episodes: How many of each piece have to be played at least.
    """
    found = read_json(place / _EVALUATION, _Judged, "expected what 'sb3-piano evaluate' writes.")
    if found is None or found.interrupted or found.num_timesteps != steps:
        return {}
    if found.env_kwargs.get("physics") != config.env_kwargs.get("physics"):
        return {}
    wanted = episodes * max(len(found.evaluations), 1)
    return dict(found.mean) if len(found.episodes) >= wanted else {}


def _lock(place: Path) -> Path:
    """Return the lock of a cell: a second attempt waits until the first one's process is gone."""
    return place.with_name(f".{place.name}{LOCK_SUFFIX}")
