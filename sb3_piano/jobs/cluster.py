"""Executor of tasks on a Ray cluster."""

from __future__ import annotations

import logging
import os
import signal
import socket
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import field
from typing import Any, TypeVar

from sb3_piano.exceptions import ConfigError, MissingPackageError, install_command, one_line
from sb3_piano.settings import Index, NotNegative, settings

T = TypeVar("T")

_GRACE = 60.0  # s, time for jobs to end after Ctrl-C before their processes are killed
_ANSWER = 10.0  # s, timeout of the first connection


@settings
class Resources:
    """Resources of a job on a cluster, and its retries after its process died."""

    num_cpus: NotNegative = 1.0
    """Cores; its libraries use as many threads, at least one."""
    num_gpus: NotNegative = 0.0
    """Graphics cards, or a part of one."""
    memory_gb: NotNegative = 0.0
    """Free memory required of a node, GB; 0 for any."""
    custom: Mapping[str, NotNegative] = field(default_factory=dict)
    """Custom resources of Ray, by the names given when the nodes were started."""
    retries: Index = 10
    """Restarts of a job after its process or node died or was preempted."""

    def options(self) -> dict[str, Any]:
        """Return the options of a Ray task."""
        return {
            "num_cpus": self.num_cpus,
            "num_gpus": self.num_gpus,
            "max_retries": self.retries,
            "memory": int(self.memory_gb * 1e9) or None,
            "resources": dict(self.custom) or None,
        }


class RayExecutor(Executor):
    """Executor of tasks on a Ray cluster, see ``open_executor``.

    An existing connection of this process is used, and stays open.
    """

    def __init__(self, address: str, resources: Resources):
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # send no statistics
        try:
            import ray
        except ImportError as error:
            raise MissingPackageError(
                f"A cluster needs Ray, which is not installed: {install_command('ray')}"
            ) from error
        self._is_ours = not ray.is_initialized()
        try:
            if self._is_ours:
                _knock(address)
                ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
        except (OSError, ValueError, RuntimeError) as error:
            raise ConfigError(
                f"No cluster of Ray can be reached at {address!r} ({one_line(error)}). Expected "
                "the address that 'ray start --head' prints, 'auto' on one of its machines, or "
                "'local'."
            ) from error
        self._ray: Any = ray
        self._task = self._ray.remote(_call).options(**resources.options())
        self._references: dict[Future[Any], Any] = {}

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Submit a task.

        The future raises the task's own exception, or ``BrokenExecutor`` if its process died and no
        retries are left.
        """
        future: Future[T] = Future()
        self._references[future] = reference = self._task.remote(os.getcwd(), fn, args, kwargs)
        reference.future().add_done_callback(lambda ended: self._pass_on(ended, future))
        return future

    def __exit__(self, *_: object) -> None:
        """Cancel the unfinished tasks and wait until all have ended."""
        left = list(self._references.values())
        for force, seconds in ((False, _GRACE), (True, None)):
            for reference in left:
                self._ray.cancel(reference, force=force)
            options = {"num_returns": len(left), "timeout": seconds, "fetch_local": False}
            left = self._ray.wait(left, **options)[1] if left else []
        if self._is_ours:
            self._ray.shutdown()

    def _pass_on(self, ended: Future[Any], future: Future[Any]) -> None:
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
            future.set_exception(BrokenExecutor(text))


def _call(folder: str, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
    """Call a function with a folder as its working directory, if the folder exists."""
    if os.path.isdir(folder):
        os.chdir(folder)
    # Nodes started in the background of a shell or by nohup ignore SIGINT.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return fn(*args, **kwargs)


def _knock(address: str) -> None:
    """Raise ``OSError`` if no server listens: Ray itself retries for minutes, ignoring signals."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdecimal():
        socket.create_connection((host, int(port)), _ANSWER).close()
