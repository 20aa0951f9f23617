"""Pools of processes: each does a job at a time, and all end with the process that made them."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.util
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing import spawn
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from signal import Signals
from typing import Any, ParamSpec, TypeVar

from sb3_piano.exceptions import ConfigError
from sb3_piano.jobs.cluster import RayExecutor, Resources
from sb3_piano.jobs.starting import share_temporary_folder
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

P = ParamSpec("P")
T = TypeVar("T")

_FILE = str(Path(__file__).with_name("worker.py"))
_PROGRAM = f"import runpy; runpy.run_path({_FILE!r}, run_name='__sb3_piano_worker__')"
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Libraries of a worker compute with one thread, unless the environment says otherwise."""


@contextlib.contextmanager
def open_executor(
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Iterator[Executor]:
    """Give an executor of processes that end with the block, or with this process; or of Ray.

    A job that its process does not survive raises a ``BrokenExecutor``, and the next one gets a new
    process; on a cluster it is begun again on any node, and must be fit for that. At the end of the
    block, jobs that have not begun are cancelled, and those that run get SIGTERM, or Ctrl-C on a
    cluster, and a minute to save what they have.

    Args:
        workers: Processes on this machine; by default one for each usable core.
        ray: Address of a cluster of Ray, which then does the jobs: ``HOST:PORT`` as
            ``ray start --head`` prints it, ``auto`` for the one that this machine belongs to,
            ``ray://HOST:PORT`` through Ray's client, or ``local`` for a new one on this machine,
            which ends with the block. Every node needs this package, of the same version. Jobs work
            in the present folder, where a node has one of its path.
        resources: What a job needs, on a cluster.

    Raises:
        ConfigError: If ``workers`` is no whole number from 1 on or given with a cluster, or that
            cannot be reached.
        MissingPackageError: If Ray is not installed.
    """
    checked("workers", workers, Count | None)
    if workers is not None and ray is not None:
        raise ConfigError(
            f"workers is {workers} with ray {ray!r}: expected one of them. How many jobs run "
            "at once on a cluster follows from what each of them needs."
        )
    executor: _Pool | RayExecutor
    executor = _Pool(workers or usable_cores()) if ray is None else RayExecutor(ray, resources)
    try:
        yield executor
    finally:
        executor.end()


class Here(Executor):
    """Executor of the calling thread: a job is done when it is submitted."""

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Call a function; return its result as a future."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except BaseException as error:
            future.set_exception(error)
        return future


class _Pool(ThreadPoolExecutor):
    """Executor whose threads each have a process do their jobs."""

    def __init__(self, workers: int) -> None:
        share_temporary_folder()
        super().__init__(workers)
        self._own = threading.local()
        self._workers: set[_Worker] = set()
        self._ended = False
        self._lock = threading.Lock()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Let a process call a function; its result is a future."""
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
        """End all processes, and wait until they have ended."""
        with self._lock:
            self._ended = True
        for worker in list(self._workers):
            worker.requests.close()  # whose end it waits for
        self.shutdown(cancel_futures=True)
        for worker in list(self._workers):
            worker.process.wait()


class _Worker:
    """A process that does one job at a time."""

    def __init__(self) -> None:
        theirs, self.requests = multiprocessing.Pipe(duplex=False)
        self._answers, answers = multiprocessing.Pipe(duplex=False)
        descriptors = (theirs.fileno(), answers.fileno())
        # Ctrl-C reaches the group of a terminal, and a system that shuts down ends whole groups: it
        # is for the process that made the pool to answer.
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM, *map(str, descriptors)],
            stdin=subprocess.DEVNULL,
            env=_ONE_THREAD | os.environ,
            pass_fds=descriptors,
            process_group=0,
        )
        theirs.close()
        answers.close()
        about = spawn.get_preparation_data(f"worker-{self.process.pid}")
        about["authkey"] = bytes(about["authkey"])
        about["temporary_folder"] = multiprocessing.util.get_temp_dir()
        with contextlib.suppress(OSError):  # it has ended, which its first job notices
            self.requests.send_bytes(pickle.dumps(about))

    def call(self, request: bytes) -> Any:
        """Return whether a job raised, and what it returned or raised."""
        try:
            self.requests.send_bytes(request)
            answer = self._answers.recv_bytes()
        except (EOFError, OSError) as error:
            code = self.process.wait()
            how = (
                f"ended with status {code}" if code >= 0 else f"was ended by {Signals(-code).name}"
            )
            raise BrokenExecutor(f"process {self.process.pid} {how}.") from error
        return pickle.loads(answer)
