"""A pool of processes that ends with the process which made it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from multiprocessing.connection import Connection

from sb3_piano.exceptions import RunError
from sb3_piano.jobs.starting import share_temporary_folder
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

_GRACE = 60.0  # s, that a training has to save what it has

ENDING = threading.Event()
"""Set in a process of a pool that ends: it may still be given jobs, which it is not to begin."""


@contextlib.contextmanager
def process_pool(workers: int | None = None) -> Iterator[Executor]:
    """Give an executor of processes that end with the block, or with this process.

    Args:
        workers: Processes; by default one for each usable core.

    Raises:
        ConfigError: If ``workers`` is not a whole number from 1 on.
    """
    count = checked("workers", workers, Count | None) or usable_cores()
    # Each reads from the environment how many threads to take, which a fork server would not see.
    context = multiprocessing.get_context("spawn")
    share_temporary_folder()
    theirs, ours = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(theirs,))
    try:
        yield pool
    finally:
        ours.close()  # nothing was ever sent: that it has an end is the message
        pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def broken_told(how_to_go_on: str) -> Iterator[None]:
    """Say how to go on when a worker was killed, as by a machine without memory.

    Raises:
        RunError: In place of the ``BrokenExecutor`` of any executor.
    """
    try:
        yield
    except BrokenExecutor as error:
        raise RunError(
            f"A worker ended before its work was done, as happens without memory: {error} What is "
            f"whole is kept; go on, with fewer workers if need be: {how_to_go_on}"
        ) from error


def _begin(lifeline: Connection) -> None:
    """Begin a process of a pool."""
    # Ctrl-C reaches the group of a terminal: it is for the process that made the pool to answer it.
    if hasattr(os, "setpgrp"):
        os.setpgrp()
    threading.Thread(target=_end_with, args=(lifeline,), daemon=True).start()


def _end_with(lifeline: Connection) -> None:
    """End this process when the pool's block ends or its process is killed.

    What trains saves a checkpoint first, see :func:`~sb3_piano.interrupts.stop_on_signal`; all else
    ends at once.
    """
    with contextlib.suppress(EOFError, OSError):
        lifeline.recv()
    ENDING.set()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)
