"""Processes that do jobs: a pool that ends with the process which made it, or any executor."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from multiprocessing.connection import Connection
from typing import TypeVar

from sb3_piano.interrupts import StopRequest, ctrl_c_ignored
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

Job = TypeVar("Job")
Result = TypeVar("Result")

_LOOK_EVERY = 0.2  # s
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


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
    theirs, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(theirs,))
    try:
        yield pool
    finally:
        ours.close()  # nothing was ever sent: that it has an end is the message
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
        KeyboardInterrupt: If the request is made.
    """
    with ctrl_c_ignored(), _one_thread_each():  # by processes, which start now, from the beginning
        waiting: set[Future[Result]] = {executor.submit(function, job) for job in jobs}
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


def _begin(lifeline: Connection) -> None:
    """Begin a process of a pool."""
    # Ctrl-C reaches all processes of a terminal; it is for the one that made the pool to answer it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    """End this process, whatever it is at, when the pool's block ends or its process is killed."""
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    os._exit(1)
