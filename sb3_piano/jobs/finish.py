"""Bringing jobs to their end: each after those it needs, wherever an executor does them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from typing import Any

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import StopRequest
from sb3_piano.jobs.job import Job, Outcome, status
from sb3_piano.jobs.mapping import LOOK_EVERY
from sb3_piano.jobs.pool import explain_worker_death


def finish(
    jobs: Sequence[Job],
    executor: Executor,
    *,
    known: Sequence[Outcome] | None = None,
    request: StopRequest | None = None,
    on_begin: Callable[[Job], object] = lambda job: None,
    on_outcome: Callable[[Outcome], object] = lambda outcome: None,
    go_on: str = "give the same command again.",
) -> list[Outcome]:
    """Do all jobs that are not done; return what came of each, in their order.

    A job that is done is left as it is, one that had stopped goes on, and one that fails, or whose
    process dies, stops only those that need it. Jobs that run when the request is made get SIGTERM
    when the block of their executor ends; what they have saved is gone on with by the same call.

    Args:
        jobs: What is to be done; names differ, and a job comes after those it needs.
        executor: Does them, where it sees their folders by the same paths.
        known: What :func:`~sb3_piano.jobs.status` says of the jobs, where that is known already.
        request: Ends the work when it is made.
        on_begin: Is called with each job before it is handed to the executor.
        on_outcome: Is called with what came of each job that was not done before.
        go_on: How to go on when a worker died.

    Raises:
        KeyboardInterrupt: If the request is made.
        RunError: If a folder was begun with other settings.
    """
    outcomes = {one.job.name: one for one in (status(jobs) if known is None else known)}
    left = {job.name: job for job in jobs if outcomes[job.name].result is None}
    for job in jobs:
        if job.settings_file.is_file():
            job.begin()
    running: dict[Future[Any], Job] = {}

    def note(outcome: Outcome) -> None:
        outcomes[outcome.job.name] = outcome
        on_outcome(outcome)

    try:
        while left or running:
            for job in _ready(left, running):
                failed = [name for name in job.needs if outcomes[name].error is not None]
                if failed:
                    del left[job.name]
                    note(Outcome(job=job, error=RunError(f"It needs {failed[0]!r}, which failed.")))
                    continue
                on_begin(job)
                _check(request)
                del left[job.name]
                running[executor.submit(Job.do, job)] = job
            done = wait(running, LOOK_EVERY, FIRST_COMPLETED).done
            for future in [one for one in running if one in done]:
                note(_outcome(running.pop(future), future, go_on))
            _check(request)
    finally:
        for future in running:
            future.cancel()
    return list(outcomes.values())


def _check(request: StopRequest | None) -> None:
    if request is not None and request.made:
        raise KeyboardInterrupt


def _ready(left: dict[str, Job], running: dict[Future[Any], Job]) -> list[Job]:
    """Return the jobs of which no job that they need is still to come."""
    waited_for = {*left, *(job.name for job in running.values())}
    return [job for job in left.values() if not waited_for.intersection(job.needs)]


def _outcome(job: Job, future: Future[Any], go_on: str) -> Outcome:
    """Return what came of a job.

    Raises:
        KeyboardInterrupt: If it was interrupted.
    """
    error = future.exception()
    if error is None:
        return Outcome(job=job, result=future.result())
    if isinstance(error, BrokenExecutor):
        return Outcome(job=job, error=explain_worker_death(error, go_on))
    if not isinstance(error, Exception):
        raise error
    return Outcome(job=job, error=error)
