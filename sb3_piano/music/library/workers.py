"""Tasks done in several processes, which may be interrupted, and one of which may be killed."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from sb3_piano.music.library.task import Outcome, Task, run_task

_KILLED = "the process that read it was killed; is there memory enough?"

_AHEAD = 2
"""Tasks handed out for each process, so that none waits."""

Tell = Callable[[Task, Outcome], None]


def run_tasks(tasks: Sequence[Task], jobs: int, tell: Tell) -> None:
    """Do tasks, and tell of each how it went, in the order in which they are done.

    After Ctrl-C what is being done is finished, and told; nothing new is begun.

    Args:
        tasks: What there is to do.
        jobs: How many processes work; with one, for one task, or on a system without the
            processes and signals of POSIX, it is this one.
        tell: Is called in this process.

    Raises:
        KeyboardInterrupt: After Ctrl-C.
    """
    has_forks = "forkserver" in multiprocessing.get_all_start_methods()
    if jobs == 1 or len(tasks) == 1 or not has_forks:
        for task in tasks:
            tell(task, run_task(task))
        return
    left = list(tasks)
    while left:
        done = _run_until_broken(left, min(jobs, len(left)), tell)
        left = [task for task in left if id(task) not in done]
        # Only what was begun can have killed its process: tasks are begun in order.
        for task in left[: _AHEAD * jobs]:
            if not _run_until_broken([task], 1, tell):
                tell(task, Outcome(error=_KILLED))
        left = left[_AHEAD * jobs :]


def _run_until_broken(tasks: Sequence[Task], jobs: int, tell: Tell) -> set[int]:
    """Do tasks until all are done or a process is killed; return the ids of the done."""
    done: set[int] = set()
    # Processes are forked from one without threads or a simulator, started once for all.
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([run_task.__module__])
    pool = ProcessPoolExecutor(jobs, mp_context=context)
    futures: dict[Future[Outcome], Task] = {}

    def tell_of(finished: Sequence[Future[Outcome]]) -> None:
        for future in finished:
            task = futures.pop(future)
            if not future.cancelled() and future.exception() is None:
                done.add(id(task))
                tell(task, future.result())

    try:
        waiting = iter(tasks)
        broken = False
        while not broken:
            with _defer_interrupt():
                for task in itertools.islice(waiting, _AHEAD * jobs - len(futures)):
                    futures[pool.submit(run_task, task)] = task
            if not futures:
                break
            finished = wait(futures, return_when=FIRST_COMPLETED).done
            broken = any(isinstance(f.exception(), BrokenProcessPool) for f in finished)
            tell_of(list(finished))
    except BrokenProcessPool:
        pass  # from submit(): a process was killed since
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        tell_of([future for future in futures if future.done()])
    return done


@contextlib.contextmanager
def _defer_interrupt() -> Iterator[None]:
    """Put Ctrl-C off; processes that are started meanwhile never see it.

    From a terminal it reaches all processes, but only this one is to act on it, and not while it
    has started half of them.
    """
    came: list[int] = []
    in_main = threading.current_thread() is threading.main_thread()
    # The processes inherit the mask. It does not keep other threads here from taking the signal.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    former = (
        signal.signal(signal.SIGINT, lambda number, _: came.append(number)) if in_main else None
    )
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if in_main:
            signal.signal(signal.SIGINT, former)
            if came:
                signal.raise_signal(signal.SIGINT)
