"""Run jobs in the order of their needs, or a function of many items, by an executor."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import nullcontext
from typing import Any, TypeVar

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.jobs.job import Job, Outcome, status
from sb3_piano.jobs.pool import open_executor

Item = TypeVar("Item")
Result = TypeVar("Result")

_AGAIN = "give the same command again."
_LOOK_EVERY = 0.2  # s, between two checks for an interruption


def finish(
    jobs: Sequence[Job],
    executor: Executor | None = None,
    *,
    known: Sequence[Outcome] | None = None,
    on_begin: Callable[[Job], object] = lambda job: None,
    on_outcome: Callable[[Outcome, int, int], object] = lambda outcome, done, total: None,
    go_on: str = _AGAIN,
    **where: Any,
) -> list[Outcome]:
    """Run all unfinished jobs; return the outcome of each, in their order.

    Finished jobs are skipped, and stopped ones resume. If a job fails or its process dies, only the
    jobs that need it are stopped. After Ctrl-C or SIGTERM no job starts; running jobs save their
    state and end with their executor. The same call resumes them.

    Args:
        jobs: Jobs with unique names; each comes after the jobs it needs.
        executor: Executor that sees the jobs' folders by the same paths; by default one is opened
            with ``where``.
        known: Result of :func:`~sb3_piano.jobs.status` for the jobs, if known already.
        on_begin: Called with each job before the executor gets it.
        on_outcome: Called with the outcome of each job that was not finished before, the number of
            ended jobs and the number of all jobs.
        go_on: How to resume, for the message about a dead worker.
        **where: ``workers``, ``ray`` and ``resources`` of :func:`~sb3_piano.jobs.open_executor`.

    Raises:
        ConfigError: If a job needs one that is not before it, a name repeats, or as of
            :func:`~sb3_piano.jobs.open_executor`.
        KeyboardInterrupt: If it was interrupted.
        RunError: If a folder was started with other settings.
    """
    outcomes = {one.job.name: one for one in (status(jobs) if known is None else known)}
    left = {job.name: job for job in jobs if outcomes[job.name].result is None}
    _check(jobs)
    running: dict[Future[Any], Job] = {}

    def note(outcome: Outcome) -> None:
        outcomes[outcome.job.name] = outcome
        on_outcome(outcome, len(jobs) - len(left) - len(running), len(jobs))

    chosen = open_executor(**where) if executor is None else nullcontext(executor)
    with stop_on_signal() as request, chosen as opened:
        try:
            while left or running:
                for job in _ready(left, running):
                    del left[job.name]
                    failed = [name for name in job.needs if outcomes[name].error is not None]
                    if failed:
                        error = RunError(f"It needs {failed[0]!r}, which failed.")
                        note(Outcome(job=job, error=error))
                        continue
                    on_begin(job)
                    if request.made:
                        raise KeyboardInterrupt
                    running[opened.submit(Job.do, job)] = job
                for future in _ended(running):
                    note(_outcome(running.pop(future), future, go_on))
                if request.made and (left or running):
                    raise KeyboardInterrupt
        finally:
            for future in running:
                future.cancel()
    return list(outcomes.values())


def _check(jobs: Sequence[Job]) -> None:
    """Check that needs come first, names are unique, and started jobs have the same settings."""
    before: set[str] = set()
    for job in jobs:
        unmet = sorted({*job.needs} - before)
        if unmet or job.name in before:
            said = f"needs {unmet[0]!r}" if unmet else "has the name of another"
            raise ConfigError(
                f"Job {job.name!r} {said}: expected names that differ, and needs that are the "
                "names of jobs before it."
            )
        before.add(job.name)
        if job.has_begun():
            job.begin()


def _ready(left: dict[str, Job], running: dict[Future[Any], Job]) -> list[Job]:
    """Return the jobs whose needs have all ended."""
    waited_for = {*left, *(job.name for job in running.values())}
    return [job for job in left.values() if not waited_for.intersection(job.needs)]


def _outcome(job: Job, future: Future[Any], go_on: str) -> Outcome:
    """Return the outcome of a job; raise ``KeyboardInterrupt`` if it was interrupted."""
    try:
        return Outcome(job=job, result=future.result())
    except BrokenExecutor as error:
        return Outcome(job=job, error=_of_death(error, go_on))
    except Exception as error:
        return Outcome(job=job, error=error)


def _of_death(error: BrokenExecutor, go_on: str) -> RunError:
    return RunError(
        f"A worker ended before its work was done, as happens without memory: {error} What is "
        f"whole is kept; go on, with fewer workers if need be: {go_on}"
    )


def map_jobs(
    executor: Executor,
    function: Callable[[Item], Result],
    items: Iterable[Item],
    request: StopRequest | None = None,
    go_on: str = _AGAIN,
) -> Generator[Result, None, None]:
    """Yield the results of a function for all items, in order of completion.

    Pending calls are cancelled when one fails, when the ``request`` is made, or when the generator
    is closed. Function, items and results must be picklable.

    Raises:
        KeyboardInterrupt: If the request is made.
        RunError: If a worker died; the message ends with ``go_on``.
    """
    running = dict.fromkeys(executor.submit(function, item) for item in items)
    try:
        while running:
            ended = _ended(running)
            if request is not None and request.made:
                raise KeyboardInterrupt
            for future in ended:
                del running[future]
                yield future.result()
    except BrokenExecutor as error:
        raise _of_death(error, go_on) from error
    finally:
        for future in running:
            future.cancel()


def _ended(running: dict[Future[Result], Any]) -> list[Future[Result]]:
    """Wait until a future ends or a short timeout passes; return the ended ones in order."""
    wait(running, _LOOK_EVERY, FIRST_COMPLETED)
    return [future for future in running if future.done()]
