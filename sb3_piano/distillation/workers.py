"""Processes that do jobs: a pool that ends with the process which made it, or any executor."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing.synchronize import Event
from typing import TypeVar

from sb3_piano.interrupts import StopRequest, ctrl_c_ignored
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

Job = TypeVar("Job")
Result = TypeVar("Result")

_LOOK_EVERY = 0.2  # s
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")

_stop: Event | None = None
"""Set when the pool of this process should end; of a process of a pool."""


class StoppedError(Exception):
    """Someone asked the work to end."""


@contextlib.contextmanager
def process_pool(workers: int | None = None) -> Iterator[Executor]:
    """Give an executor of processes that end with the block, or with this process.

    Args:
        workers: Processes; by default one for each usable core.

    Raises:
        ConfigError: If ``workers`` is not a whole number from 1 on.
    """
    count = checked("workers", workers, Count | None) or usable_cores()
    context = multiprocessing.get_context("spawn")  # fork is not safe with torch's threads
    stop = context.Event()
    pool = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(stop,))
    try:
        yield pool
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def map_jobs(
    executor: Executor,
    function: Callable[[Job], Result],
    jobs: Iterable[Job],
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
        StoppedError: If the request is made.
    """
    with ctrl_c_ignored(), _one_thread_each():  # by processes, which start now, from the beginning
        waiting: set[Future[Result]] = {executor.submit(function, job) for job in jobs}
    try:
        while waiting:
            done, waiting = wait(waiting, _LOOK_EVERY, FIRST_COMPLETED)
            if request is not None and request.made:
                raise StoppedError
            for future in done:
                yield future.result()
    finally:
        for future in waiting:
            future.cancel()


def check_stop() -> None:
    """Raise :class:`StoppedError` in a process whose pool should end; jobs call it now and then."""
    if _stop is not None and _stop.is_set():
        raise StoppedError


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


def _begin(stop: Event) -> None:
    """Begin a process of a pool."""
    global _stop
    _stop = stop
    # Ctrl-C reaches all processes of a terminal; it is for the one that made the pool to answer it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the one that made it is killed, which no job would notice."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "of a pool"
    parent.join()
    os._exit(1)
