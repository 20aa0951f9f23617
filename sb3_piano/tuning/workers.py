"""Workers of a study: processes that run one trial after the other, here or on a cluster of Ray."""

from __future__ import annotations

import contextlib
import functools
import gc
import multiprocessing
import os
import platform
import signal
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from multiprocessing.connection import Connection
from types import ModuleType
from typing import Any

import optuna
from optuna.trial import FixedTrial

from sb3_piano.exceptions import one_line
from sb3_piano.interrupts import ctrl_c_ignored
from sb3_piano.jobs.cluster import work_in
from sb3_piano.jobs.starting import process_context
from sb3_piano.links import make_folder
from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.study import StudyConfig, StudyFolder


class Worker(ABC):
    """The parent's end of a worker."""

    connection: Connection
    """From which it is heard; that it has an end is the worker's death."""
    trial: optuna.Trial | None = None
    """The trial that it runs."""
    said: tuple[Any, ...] | None = None
    """Its last report, if that is not in the store yet."""

    def begin(self, trial: optuna.Trial) -> None:
        """Let it run a trial."""
        self.trial = trial
        with contextlib.suppress(OSError):  # it has died, which its connection tells too
            self.send((trial.number, trial.params))

    @abstractmethod
    def send(self, message: Any) -> None:
        """Send a trial, or whether the one that runs is to be pruned."""

    @abstractmethod
    def kill(self) -> str:
        """End it at once, if it has not ended by itself; return how it ended."""


MakeWorker = Callable[[StudyConfig, StudyFolder], Worker]
"""Makes a worker of a study."""


class ProcessWorker(Worker):
    """A child process."""

    def __init__(self, config: StudyConfig, folder: StudyFolder):
        context = process_context()
        self.connection, end = context.Pipe()
        self._process = context.Process(target=_work, args=(end, config, folder), daemon=False)
        with ctrl_c_ignored():
            self._process.start()
        end.close()  # so that the worker's death is the end of what it says

    def send(self, message: Any) -> None:
        """Send by the pipe."""
        self.connection.send(message)

    def kill(self) -> str:
        """End the process."""
        self._process.kill()
        self._process.join()
        code = self._process.exitcode
        assert code is not None, "the process has ended"
        return f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"


class ActorWorker(Worker):
    """An actor on a cluster of Ray, whose nodes all see the study's folder.

    The first argument is the package, connected to the cluster; with it bound by
    ``functools.partial`` the class makes workers as :class:`ProcessWorker` does.
    """

    def __init__(self, ray: ModuleType, config: StudyConfig, folder: StudyFolder):
        # One thread for what is sent, and one in which what is said is waited for.
        actor = ray.remote(_Actor).options(max_concurrency=2, num_cpus=1)
        self._ray = ray
        self._actor = actor.remote(config, StudyFolder(folder.path.absolute()), os.getcwd())
        self._end = "its actor"
        self.connection, said = multiprocessing.Pipe(duplex=False)
        threading.Thread(target=self._pass_on, args=(said,), daemon=True).start()

    def send(self, message: Any) -> None:
        """Send by a call."""
        self._actor.send.remote(message)

    def kill(self) -> str:
        """End the actor."""
        self._ray.kill(self._actor)
        return self._end

    def _pass_on(self, said: Connection) -> None:
        """Pass on what the actor says until it is gone, or nobody listens any more."""
        with said, contextlib.suppress(OSError):
            while True:
                try:
                    said.send(self._ray.get(self._actor.recv.remote()))
                except self._ray.exceptions.RayError as error:
                    self._end = one_line(error)
                    return


class _Actor:
    """Runs trials in a thread, so that it can be spoken to meanwhile."""

    def __init__(self, config: StudyConfig, folder: StudyFolder, started_in: str):
        _print_into_log(folder)
        work_in(started_in)
        self._connection, end = multiprocessing.Pipe()
        run = functools.partial(_run_trials, end, Objective(config, folder))
        threading.Thread(target=run, daemon=True).start()

    def send(self, message: Any) -> None:
        self._connection.send(message)

    def recv(self) -> Any:
        return self._connection.recv()


class _SentTrial(FixedTrial):
    """A trial whose settings were chosen in the parent, which is told how it does."""

    def __init__(self, connection: Connection, number: int, params: dict[str, Any]):
        super().__init__(params, number)
        self._connection = connection
        self._is_over = False

    def report(self, value: float, step: int) -> None:
        self._connection.send(("report", value, step))
        self._is_over = self._connection.recv()

    def should_prune(self) -> bool:
        return self._is_over

    def set_user_attr(self, key: str, value: Any) -> None:
        self._connection.send(("note", key, value))


def _work(connection: Connection, config: StudyConfig, folder: StudyFolder) -> None:
    """Run the trials that come; the target of a process."""
    os.setpgrp()  # Ctrl-C on the terminal is for the parent, which kills its workers
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _print_into_log(folder)
    _run_trials(connection, Objective(config, folder))


def _print_into_log(folder: StudyFolder) -> None:
    """Let all that this process prints go to a file of the study."""
    make_folder(folder.workers_dir)
    with (folder.workers_dir / f"{platform.node()}-{os.getpid()}.log").open("ab") as log:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
            os.dup2(log.fileno(), stream.fileno())


def _run_trials(connection: Connection, objective: Objective) -> None:
    while True:
        try:
            number, params = connection.recv()
        except EOFError:
            return
        connection.send(_end_of(objective, _SentTrial(connection, number, params)))
        gc.collect()  # models refer to themselves: their memory would pile up


def _end_of(objective: Objective, trial: FixedTrial) -> tuple[Any, ...]:
    """Run a trial and return what is to be said of its end."""
    try:
        return "complete", objective(trial)
    except optuna.TrialPruned:
        return ("pruned",)
    except Exception:
        sys.excepthook(*sys.exc_info())  # for the log; the reason is noted with the trial
        return ("failed",)


def _end_with_parent() -> None:
    """End this process once the one that started it is gone, however it died."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker is started by another process"
    parent.join()
    os._exit(1)
