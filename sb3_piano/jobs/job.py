"""Jobs, resumable work in folders, and how lists of them are run in the order of their needs."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from sb3_piano.exceptions import ConfigError, RunError, SB3PianoError, no_memory, one_line
from sb3_piano.files import read_json, write_json
from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.jobs.folders import SETTINGS, begin_or_resume, is_empty
from sb3_piano.jobs.pool import open_executor
from sb3_piano.locks import LOCK_SUFFIX, hold

Item = TypeVar("Item")
Result = TypeVar("Result")

_AGAIN = "give the same command again."
_LOOK_EVERY = 0.2  # s, between two checks for an interruption

Work = Callable[[Any], Mapping[str, Any]]
"""Function that does a job, or the rest of it, and returns its result."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """Resumable work in a folder of its own.

    The folder gets ``job.yml``, the settings, when the work begins, and ``result.json`` when it is
    done. A subclass may use other files, and may report its progress.
    """

    name: str
    """Name, unique among the jobs of a call."""
    folder: Path
    """Folder of the job, by a path that is valid in every process."""
    work: Work
    """Function that does the job, or resumes it; raises ``KeyboardInterrupt`` if it is interrupted.
    Other processes must be able to import it. The result has JSON types."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings in YAML types; a folder with other settings is refused."""
    needs: tuple[str, ...] = ()
    """Names of the jobs that must finish first."""

    @property
    def settings_file(self) -> Path:
        """File of the job's settings."""
        return self.folder / SETTINGS

    def has_begun(self) -> bool:
        """Return whether the settings file exists."""
        return self.settings_file.is_file()

    @property
    def result_file(self) -> Path:
        """File of the result, which is written last."""
        return self.folder / "result.json"

    def result(self) -> Mapping[str, Any] | None:
        """Return the result, or ``None`` if the job is not finished; refuse a damaged file."""
        return read_json(self.result_file, dict[str, Any], "delete it, and it is made again.")

    def begin(self) -> None:
        """Write the settings, if any, into a new folder; refuse other settings or other files."""
        if self.settings:
            begin_or_resume(self.settings_file, f"job {self.name!r}", self.settings)

    def progress(self) -> tuple[int, int] | None:
        """Return the amounts done and in total, also of a running job; ``None`` if unknown."""
        return None

    def do(self) -> Mapping[str, Any]:
        """Do the rest of the job and return its result; a second process waits for the first."""
        with hold(self.folder.with_name(f".{self.folder.name}{LOCK_SUFFIX}")):
            found = self.result()
            if found is None:
                self.begin()
                try:
                    found = self.work(self)
                    write_json(self.result_file, found)
                except Exception:  # a job without files may have other settings next time
                    if self.folder.is_dir() and is_empty(self.folder):
                        shutil.rmtree(self.folder, ignore_errors=True)
                    raise
            return found


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """State of a job: its result, its error, or neither."""

    job: Job
    result: Mapping[str, Any] | None = None
    """Result of a finished job."""
    error: Exception | None = None
    """Exception of a failed job."""

    @property
    def reason(self) -> str:
        """One-line reason of a failure; empty if it did not fail."""
        return "" if self.error is None else reason_of(self.error)

    @property
    def state(self) -> str:
        """``failed``, ``finished``, the steps done, ``begun`` or ``not begun``."""
        if self.error is not None:
            return "failed"
        if self.result is not None:
            return "finished"
        done = self.job.progress()
        if done is not None and done[0]:
            return f"{done[0]} of {done[1]} steps"
        return "begun" if self.job.has_begun() else "not begun"


def reason_of(error: Exception) -> str:
    """Return the reason of a failure in one line."""
    reason = one_line(error)
    if not isinstance(error, SB3PianoError) and str(error):
        reason = f"{type(error).__name__}: {reason}"
    return f"out of memory: {reason}" if no_memory(error) else reason


def status(jobs: Iterable[Job]) -> list[Outcome]:
    """Read the state of each job from its folder, also of running jobs."""
    return [Outcome(job=job, result=job.result()) for job in jobs]


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
