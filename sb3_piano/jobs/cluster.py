"""Clusters of Ray as executors."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import field
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

from sb3_piano.exceptions import ConfigError, MissingPackageError, install_command, one_line
from sb3_piano.settings import Index, NotNegative, settings

P = ParamSpec("P")
T = TypeVar("T")

_GRACE = 60.0  # s, that jobs have to end after Ctrl-C before their processes are ended
_ANSWER = 10.0  # s, in which a cluster has to answer


@settings
class Resources:
    """What a job on a cluster needs, and how often it is begun again when its process is gone."""

    num_cpus: NotNegative = 1.0
    """Cores; as many threads, at least one, are what its libraries compute with."""
    num_gpus: NotNegative = 0.0
    """Graphics cards, or a part of one."""
    memory_gb: NotNegative = 0.0
    """Memory that a node must have left, GB; 0 for any."""
    custom: Mapping[str, NotNegative] = field(default_factory=dict)
    """Further resources, as the nodes of the cluster were started with."""
    retries: Index = 10
    """How often a job is begun again after its process or its node died, or was taken away."""

    def options(self) -> dict[str, Any]:
        """Return the options of a task of Ray."""
        options: dict[str, Any] = {
            "num_cpus": self.num_cpus,
            "num_gpus": self.num_gpus,
            "max_retries": self.retries,
        }
        if self.memory_gb:
            options["memory"] = int(self.memory_gb * 1e9)
        if self.custom:
            options["resources"] = dict(self.custom)
        return options


@contextlib.contextmanager
def ray_executor(
    address: str,
    resources: Resources = Resources(),  # noqa: B008 - frozen
) -> Iterator[Executor]:
    """Give an executor whose jobs are tasks on a cluster of Ray.

    A task whose process, or whose node, died or was taken away is begun again on any node: a job
    must be fit for that. Tasks work in the present folder, where a node has one of its path. Those
    that have not ended with the block are cancelled; those that run get Ctrl-C, and are ended if
    that has not ended them within a minute. Every node needs this package, of the same version.
    A connection that this process has already is used, and kept.

    Args:
        address: ``HOST:PORT`` as ``ray start --head`` prints it, ``auto`` for the cluster that
            this machine belongs to, ``ray://HOST:PORT`` through Ray's client, or ``local`` for a
            new one on this machine, which ends with the block.
        resources: What a job needs.

    Raises:
        ConfigError: If no cluster answers there.
        MissingPackageError: If Ray is not installed.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is sent to anybody
    try:
        import ray
    except ImportError as error:
        raise MissingPackageError(
            f"Ray is not installed, which a cluster needs: {install_command('ray')}"
        ) from error
    is_ours = not ray.is_initialized()
    try:
        if is_ours:
            _knock(address)
            ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
    except (OSError, ValueError, RuntimeError) as error:
        raise ConfigError(
            f"No cluster of Ray can be reached at {address!r} ({one_line(error)}). Expected the "
            "address that 'ray start --head' prints, 'auto' on one of its machines, or 'local'."
        ) from error
    executor = _RayExecutor(ray, resources)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)
        if is_ours:
            ray.shutdown()


def _knock(address: str) -> None:
    """Raise an ``OSError`` where nobody listens: Ray tries for minutes, and heeds no signal."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdecimal():
        socket.create_connection((host, int(port)), _ANSWER).close()


class _RayExecutor(Executor):
    """Executor of tasks; :func:`ray_executor` makes one."""

    def __init__(self, ray: ModuleType, resources: Resources):
        self._ray = ray
        self._task = ray.remote(_call).options(**resources.options())
        self._references: dict[Future[Any], Any] = {}
        self._lock = threading.Lock()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Begin a task; its result is a future as of any executor.

        What the job raised is raised as it was; the end of its process, again and again, is a
        :class:`~concurrent.futures.process.BrokenProcessPool` as of a pool of processes.
        """
        reference = self._task.remote(os.getcwd(), fn, args, kwargs)
        future: Future[T] = Future()
        with self._lock:
            self._references[future] = reference
        reference.future().add_done_callback(lambda ended: self._pass_on(ended, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End: cancel what has not ended, if asked to, and wait for the rest."""
        with self._lock:
            left = dict(self._references)
        references = list(left.values())
        if cancel_futures:
            for reference in references:
                self._ray.cancel(reference)
            for reference in self._unfinished(references, _GRACE):
                self._ray.cancel(reference, force=True)
        if wait:
            self._unfinished(references, None)

    def _unfinished(self, references: list[Any], seconds: float | None) -> list[Any]:
        """Wait for tasks; return those that have not ended by then."""
        if not references:
            return []
        options = {"num_returns": len(references), "timeout": seconds, "fetch_local": False}
        left: list[Any] = self._ray.wait(references, **options)[1]
        return left

    def _pass_on(self, ended: Future[Any], future: Future[Any]) -> None:
        with self._lock:
            self._references.pop(future, None)
        if not future.set_running_or_notify_cancel():
            return
        error = ended.exception()
        if error is None:
            future.set_result(ended.result())
        elif isinstance(error, self._ray.exceptions.RayTaskError):
            future.set_exception(error.cause)
        else:
            text = f"A job ended on the cluster: {one_line(error)}"
            future.set_exception(BrokenProcessPool(text))


def _call(folder: str, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
    """Call a function where relative paths mean what they do in a folder, if it is there."""
    if os.path.isdir(folder):
        os.chdir(folder)
    # Nodes that were started in the background of a shell, or by nohup, have it ignored.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return fn(*args, **kwargs)
