"""Jobs on processes of this machine or on a cluster, as a command line asks for."""

from __future__ import annotations

from concurrent.futures import Executor
from contextlib import AbstractContextManager

from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs.cluster import Resources, ray_executor
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
