"""Process pools: each process runs one job at a time and ends with its parent."""

from __future__ import annotations

import contextlib
import os
import pickle
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing.reduction import ForkingPickler
from signal import Signals
from typing import Any, ParamSpec, TypeVar

from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs.cluster import RayExecutor, Resources
from sb3_piano.jobs.starting import ONE_THREAD, process_context
from sb3_piano.jobs.worker import serve
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

P = ParamSpec("P")
T = TypeVar("T")


@contextlib.contextmanager
def open_executor(
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Iterator[Executor]:
    """Open an executor of worker processes, or of a Ray cluster, for the length of a block.

    Worker processes end with the block or with this process. If one dies, its job raises
    ``BrokenExecutor`` and the next job gets a new process; on a cluster the job restarts on any
    node, and must support that. At the end of the block, pending jobs are cancelled; running ones
    get SIGTERM, or Ctrl-C on a cluster, and a minute to save their state.

    Args:
        workers: Processes on this machine; by default one for each usable core.
        ray: Address of a Ray cluster that runs the jobs: ``HOST:PORT`` as printed by
            ``ray start --head``, ``auto`` for this machine's cluster, ``ray://HOST:PORT`` through
            Ray's client, or ``local`` for a new one on this machine, which ends with the block.
            Every node needs the same version of this package. Jobs run in the path of the working
            directory, on nodes that have it.
        resources: Resources of a job on a cluster.

    Raises:
        ConfigError: If ``workers`` is not a positive integer or is given with a cluster, or the
            cluster cannot be reached.
        MissingPackageError: If Ray is not installed.
    """
    checked("workers", workers, Count | None)
    if workers is not None and ray is not None:
        raise ConfigError(
            f"workers is {workers} with ray {ray!r}: expected one of them. On a cluster, the "
            "resources of the jobs decide how many run at once."
        )
    executor: _Pool | RayExecutor
    executor = _Pool(workers or usable_cores()) if ray is None else RayExecutor(ray, resources)
    try:
        yield executor
    finally:
        executor.end()


class Here(Executor):
    """Executor that runs each job in the calling thread on submission."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function; return its result as a future."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


class _Pool(ThreadPoolExecutor):
    """Executor with one worker process for each thread."""

    def __init__(self, workers: int) -> None:
        super().__init__(workers)
        self._own = threading.local()
        self._workers: set[_Worker] = set()
        self._ended = False
        self._lock = threading.Lock()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function in a worker process; return its result as a future."""
        return super().submit(self._call, fn, args, kwargs)

    def _call(self, fn: Callable[..., Any], args: Any, kwargs: Any) -> Any:
        request = bytes(ForkingPickler.dumps((fn, args, kwargs)))
        worker = getattr(self._own, "worker", None)
        if worker is None:
            with self._lock:
                if self._ended:
                    raise KeyboardInterrupt
                worker = _Worker()
                self._workers.add(worker)
            self._own.worker = worker
        try:
            failed, found = worker.call(request)
        except BrokenExecutor:
            self._own.worker = None
            self._workers.discard(worker)
            raise
        if failed:
            raise found
        return found

    def end(self) -> None:
        """End all worker processes and wait for them."""
        with self._lock:
            self._ended = True
        for worker in list(self._workers):
            worker.requests.close()  # the worker ends when this pipe closes
        self.shutdown(cancel_futures=True)
        for worker in list(self._workers):
            worker.process.join()


class _Worker:
    """Worker process that runs one job at a time."""

    def __init__(self) -> None:
        context = process_context()
        theirs, self.requests = context.Pipe(duplex=False)
        self._answers, answers = context.Pipe(duplex=False)
        arguments = (theirs, answers, ONE_THREAD | os.environ)
        self.process = context.Process(target=serve, args=arguments)
        self.process.start()
        theirs.close()
        answers.close()

    def call(self, request: bytes) -> Any:
        """Run a job; return whether it raised, and its result or exception."""
        try:
            self.requests.send_bytes(request)
            answer = self._answers.recv_bytes()
        except (EOFError, OSError) as error:
            self.process.join()
            code = self.process.exitcode or 0
            how = (
                f"ended with status {code}" if code >= 0 else f"was ended by {Signals(-code).name}"
            )
            raise BrokenExecutor(f"process {self.process.pid} {how}.") from error
        return pickle.loads(answer)
