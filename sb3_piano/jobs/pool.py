"""Worker processes: each runs one job at a time and ends with its parent."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import queue
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from signal import SIGTERM, Signals
from typing import Any, TypeVar

from sb3_piano.exceptions import ConfigError, sendable
from sb3_piano.jobs.cluster import RayExecutor, Resources
from sb3_piano.orphans import stop_looking
from sb3_piano.settings import Count, checked
from sb3_piano.threads import usable_cores

T = TypeVar("T")

_GRACE = 60.0  # s, time for a training to save a checkpoint
_ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Default environment variables of new processes: one thread per library."""
_LIBRARIES = ("torch", "gymnasium", "stable_baselines3", "sb3_contrib", "scipy.optimize")


def open_executor(
    workers: int | None = None,
    ray: str | None = None,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Executor:
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
    return _Pool(workers or usable_cores()) if ray is None else RayExecutor(ray, resources)


class Here(Executor):
    """Executor that runs each job in the calling thread on submission."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
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

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Call a function in a worker process; return its result as a future."""
        return super().submit(self._call, fn, args, kwargs)

    def _call(self, fn: Callable[..., Any], args: Any, kwargs: Any) -> Any:
        worker = getattr(self._own, "worker", None)
        if worker is None:
            with self._lock:
                if self._ended:
                    raise KeyboardInterrupt
                self._own.worker = worker = _Worker()
                self._workers.add(worker)
        try:
            return worker.call(bytes(ForkingPickler.dumps((fn, args, kwargs))))
        except BrokenExecutor:
            self._own.worker = None
            self._workers.discard(worker)
            raise

    def __exit__(self, *_: object) -> None:
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
        theirs, self.requests = multiprocessing.Pipe(duplex=False)
        self._answers, answers = multiprocessing.Pipe(duplex=False)
        made_by = _ONE_THREAD | os.environ, sys.orig_argv
        self.process = start_process(_serve, theirs, answers, *made_by)
        theirs.close()
        answers.close()

    def call(self, request: bytes) -> Any:
        """Run a job; return its result, or raise its exception."""
        try:
            self.requests.send_bytes(request)
            answer = self._answers.recv_bytes()
        except (EOFError, OSError) as error:
            self.process.join()
            code = self.process.exitcode or 0
            how = f"was ended by {Signals(-code).name}" if code < 0 else f"ended with status {code}"
            raise BrokenExecutor(f"process {self.process.pid} {how}.") from error
        failed, found = pickle.loads(answer)
        if failed:
            raise found
        return found


def _serve(asked: Connection, answers: Connection, env: dict[str, str], argv: list[str]) -> None:
    """Run the jobs from one pipe and send their results through another, until both close."""
    sys.orig_argv[:] = argv  # which made what the jobs write, so that their records name it
    if hasattr(os, "setpgid"):  # signals of the parent's group are the parent's to handle
        os.setpgid(0, 0)
    os.environ.clear()
    os.environ.update(env)
    torch: Any = sys.modules.get("torch")  # a server from before imported it with other threads
    if torch is not None and env["OMP_NUM_THREADS"].isdecimal():
        torch.set_num_threads(int(env["OMP_NUM_THREADS"]))
    todo: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    ending = threading.Event()
    threading.Thread(target=_listen, args=(asked, todo, ending), daemon=True).start()
    stop_looking()
    while not ending.is_set():
        answer = _answer(todo.get())
        with contextlib.suppress(OSError):  # the parent has ended
            answers.send_bytes(answer)


def _listen(requests: Connection, todo: queue.SimpleQueue[bytes], ending: threading.Event) -> None:
    """Receive requests; end this process when the pool ends or its process was killed.

    A training saves a checkpoint first, see :func:`~sb3_piano.interrupts.stop_on_signal`; any other
    job ends at once.
    """
    with contextlib.suppress(EOFError, OSError):
        while True:
            todo.put(requests.recv_bytes())
    ending.set()
    os.kill(os.getpid(), SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)


def _answer(request: bytes) -> bytes:
    """Call a function; return, pickled, whether it raised, and its result or exception."""
    try:
        function, arguments, options = pickle.loads(request)
        return pickle.dumps((False, function(*arguments, **options)))
    except BaseException as error:
        return pickle.dumps((True, sendable(error)))


def start_process(target: Callable[..., object], *args: Any, daemon: bool = False) -> BaseProcess:
    """Start a process that calls a function; fork is not safe with threads.

    On Linux, processes are forked from a server without threads that has imported the slow
    libraries once, if this process has. It starts with the first process and does not see later
    changes of environment variables. Elsewhere each process is a new interpreter.
    """
    context: Any = multiprocessing.get_context("spawn")  # macOS's libraries are not fork-safe
    if sys.platform == "linux":
        context = multiprocessing.get_context("forkserver")
        loaded = [name for name in _LIBRARIES if name in sys.modules]
        context.set_forkserver_preload(["sb3_piano.orphans", *loaded])
    process: BaseProcess = context.Process(target=target, args=args, daemon=daemon)
    added = _ONE_THREAD.keys() - os.environ.keys()
    for is_last in (False,) * 20 + (True,):
        os.environ.update({name: _ONE_THREAD[name] for name in added})
        try:
            process.start()
            break
        except (ConnectionError, EOFError):  # the server was killed; another one may start
            if is_last:
                raise
            time.sleep(0.1)
        finally:
            for name in added:
                os.environ.pop(name, None)
    return process
