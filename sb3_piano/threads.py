"""A job for each of several environments, done in threads; and the threads of torch.

MuJoCo's bindings release Python's lock while they simulate, and a piano environment spends nearly
all of its time there: threads of one process step environments at the same time, without the
copying between processes.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import queue
import threading
import weakref
from collections.abc import Callable, Iterator
from typing import Annotated, Any

from annotated_types import Ge

from sb3_piano.settings import Whole, checked

_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")

Job = Callable[[int], object]


class ThreadTeam:
    """Do a job for each of n slots, shared out among threads.

    Each thread has neighbouring slots, the first ones belong to the calling thread. As long as that
    stays the same, a slot is always served by one thread, which drawing contexts need.

    Raises:
        ConfigError: If ``n_threads`` is not a whole number from 1 on.
    """

    def __init__(self, n_slots: int, n_threads: int | None = None):
        """Share out the slots. The threads start with the first job.

        Args:
            n_slots: How many slots there are, at least 1.
            n_threads: Threads to use, the calling one included; by default one for each slot or
                each usable core, whichever are fewer. More than slots are never used.
        """
        n_threads = checked("n_threads", n_threads, Annotated[Whole, Ge(1)] | None)
        self.n_threads = min(n_slots, n_threads or usable_cores())
        """Number of threads that do the work, the calling one included."""
        bounds = [n_slots * i // self.n_threads for i in range(self.n_threads + 1)]
        self._own, *self._shares = (range(*pair) for pair in itertools.pairwise(bounds))
        self._workers: list[_Worker] = []

    def run(self, job: Job) -> None:
        """Do a job for every slot; return or raise when no thread is at work any more.

        Args:
            job: Called with each slot's number. A thread leaves out the rest of its slots if one
                of them fails.

        Raises:
            BaseException: What the job raised, for the first slot that failed.
        """
        if not self._workers:
            self._workers = [_Worker(slots) for slots in self._shares]
        tasks = [_Task(job, worker.slots) for worker in self._workers]
        try:
            for worker, task in zip(self._workers, tasks, strict=True):
                worker.begin(task)
            for slot in self._own:
                job(slot)
            for task in tasks:
                task.wait()
        except BaseException:  # Ctrl-C may come at any line: not all tasks need have begun
            self._rest()
            raise
        for task in tasks:
            if task.error is not None:
                raise task.error

    def close(self) -> None:
        """Wait for the threads and end them; another job would start new ones."""
        for worker in self._workers:
            worker.end()
        self._workers = []

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_workers": []}  # a copy starts threads of its own

    def _rest(self) -> None:
        """Wait until each thread has done all that it was told to do."""
        tasks = [_Task(_nothing, worker.slots) for worker in self._workers]
        for worker, task in zip(self._workers, tasks, strict=True):
            worker.begin(task)
        for task in tasks:
            task.wait()


def usable_cores() -> int:
    """Return on how many cores this process may run."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Task:
    """A job for some slots, and how it ended."""

    def __init__(self, job: Job, slots: range):
        self._job = job
        self._slots = slots
        self._under_way = threading.Lock()
        self._under_way.acquire()
        self.error: BaseException | None = None

    def do(self) -> None:
        try:
            for slot in self._slots:
                self._job(slot)
        except BaseException as error:
            self.error = error
        finally:
            self._under_way.release()

    def wait(self) -> None:
        with self._under_way:
            pass


class _Worker:
    """A thread that does one task after the other; it ends with its owner."""

    def __init__(self, slots: range):
        self.slots = slots
        tasks: queue.SimpleQueue[_Task | None] = queue.SimpleQueue()
        # Neither thread nor finalizer may know this object: it could then never be forgotten.
        self._thread = threading.Thread(target=_work, args=(tasks,), daemon=True)
        self._thread.start()
        self.begin: Callable[[_Task], None] = tasks.put
        self._dismiss = weakref.finalize(self, tasks.put, None)

    def end(self) -> None:
        self._dismiss()
        self._thread.join()


def _work(tasks: queue.SimpleQueue[_Task | None]) -> None:
    while (task := tasks.get()) is not None:
        task.do()
        del task  # while waiting for the next one, keep no environment alive


def _nothing(slot: int) -> None:
    del slot


@contextlib.contextmanager
def torch_threads(number: int | None = None) -> Iterator[None]:
    """Let torch compute with this many threads meanwhile, and afterwards with as many as before.

    The number is one of the whole process. Everything in this package that runs a network does so
    in this context, so that the program around it keeps its own number.

    Args:
        number: Threads, at least 1. By default one, unless ``OMP_NUM_THREADS`` or
            ``MKL_NUM_THREADS`` is set: then the number stays as it is. Networks as small as those
            of piano players gain nothing from a second thread, and lose most of their speed as soon
            as anything else runs: at the end of each operation the threads wait for one another, as
            busily as if they worked.
    """
    import torch  # here, since environments alone do without

    former = torch.get_num_threads()
    if number is None:
        number = former if any(os.environ.get(name) for name in _VARIABLES) else 1
    torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(former)
