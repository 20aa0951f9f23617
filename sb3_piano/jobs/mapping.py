"""Jobs that an executor does, whose results are taken as they come."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from typing import TypeVar

from sb3_piano.interrupts import StopRequest, ctrl_c_ignored
from sb3_piano.jobs.pool import ENDING

Item = TypeVar("Item")
Result = TypeVar("Result")

_LOOK_EVERY = 0.2  # s
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def map_jobs(
    executor: Executor,
    function: Callable[[Item], Result],
    jobs: Iterable[Item],
    request: StopRequest | None = None,
) -> Generator[Result, None, None]:
    """Yield the results of jobs as they come, in any order.

    Jobs that have not begun are cancelled when one fails, or when the generator is closed.

    Args:
        executor: Does the jobs; functions, jobs and results must be fit to be pickled.
        function: What is called with each job.
        jobs: What to do.
        request: Ends it when it is made.

    Raises:
        KeyboardInterrupt: If the request is made.
    """
    with ctrl_c_ignored(), _one_thread_each():  # by processes, which start now, from the beginning
        waiting: set[Future[Result]] = {executor.submit(_begin, function, job) for job in jobs}
    try:
        while waiting:
            done, waiting = wait(waiting, _LOOK_EVERY, FIRST_COMPLETED)
            if request is not None and request.made:
                raise KeyboardInterrupt
            for future in done:
                yield future.result()
    finally:
        for future in waiting:
            future.cancel()


def _begin(function: Callable[[Item], Result], job: Item) -> Result:
    """Do a job where it is done, unless the process there is to end."""
    if ENDING.is_set():
        raise KeyboardInterrupt
    return function(job)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that start meanwhile compute with one thread each, unless it is said already.

    Libraries that are loaded, as in this process, keep their number.
    """
    changed = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(changed, "1"))
    try:
        yield
    finally:
        for name in changed:
            del os.environ[name]
