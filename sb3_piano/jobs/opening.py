"""Jobs on processes of this machine or on a cluster, as a command line asks for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, nullcontext

from sb3_piano.exceptions import ConfigError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs.cluster import Resources, ray_executor
from sb3_piano.jobs.finish import finish
from sb3_piano.jobs.job import Job, Outcome, status
from sb3_piano.jobs.pool import process_pool


def open_executor(
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> AbstractContextManager[Executor]:
    """Return the executor that a command line asks for, as a context.

    Args:
        workers: Processes on this machine; by default one for each usable core.
        ray: Address of a cluster of Ray, which then does the jobs; see
            :func:`~sb3_piano.jobs.connected_to_ray`.
        resources: What a job needs, on a cluster.

    Raises:
        ConfigError: If ``workers`` is out of range or given with a cluster, or that cannot be
            reached.
        MissingPackageError: If Ray is not installed.
    """
    if ray is None:
        return process_pool(workers)
    if workers is not None:
        raise ConfigError(
            f"workers is {workers} with ray {ray!r}: expected one of them. How many jobs run at "
            "once on a cluster follows from what each of them needs."
        )
    return ray_executor(ray, resources)


def run_jobs(
    jobs: Sequence[Job],
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
    known: Sequence[Outcome] | None = None,
    on_outcome: Callable[[Outcome, int, int], object] = lambda outcome, done, total: None,
) -> list[Outcome]:
    """Bring jobs to their end, see :func:`~sb3_piano.jobs.finish`; Ctrl-C and SIGTERM end it.

    Args:
        jobs: What is to be done.
        executor: Does them; by default what the next three say, see :func:`open_executor`.
        workers: Processes on this machine.
        ray: Address of a cluster of Ray.
        resources: What a job needs, on a cluster.
        known: As of :func:`~sb3_piano.jobs.finish`.
        on_outcome: Is called with what came of each job that was not done before, and how many of
            how many have come to an end.

    Raises:
        ConfigError: If ``workers`` is out of range, or the cluster cannot be reached.
        KeyboardInterrupt: If it was interrupted. The same call goes on.
        RunError: If a folder was begun with other settings.
    """
    known = status(jobs) if known is None else known
    done = sum(one.result is not None for one in known)

    def tell(outcome: Outcome) -> None:
        nonlocal done
        done += 1
        on_outcome(outcome, done, len(jobs))

    chosen = open_executor(workers, ray, resources) if executor is None else nullcontext(executor)
    with stop_on_signal() as request, chosen as opened:
        return finish(jobs, opened, known=known, request=request, on_outcome=tell)
