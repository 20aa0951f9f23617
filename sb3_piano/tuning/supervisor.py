"""Watching over the workers of one machine until the study is complete."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import wait
from multiprocessing.context import SpawnProcess

import optuna
from optuna.exceptions import StorageInternalError
from optuna.trial import TrialState

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.tuning.attributes import counting
from sb3_piano.tuning.store.orphans import requeue_orphans
from sb3_piano.tuning.worker import Job, is_open, work

OnProgress = Callable[[list[optuna.trial.FrozenTrial]], object]
"""Is called with the trials that count."""

_POLL_SECONDS = 1.0
_MAX_DEATHS = 3


def supervise(
    study: optuna.Study, job: Job, n_workers: int, on_progress: OnProgress = lambda trials: None
) -> bool:
    """Run a study with worker processes; return whether it was interrupted.

    A worker that dies is replaced, and the settings of its trial are queued again. It is over when
    the study has all its trials, those of workers elsewhere included. Ctrl-C and SIGTERM end the
    workers, whose trials are queued again; the second time they are killed.

    Raises:
        RunError: If workers die again and again without having finished a trial.
    """
    with stop_on_signal() as request, contextlib.ExitStack() as stack:
        team = stack.enter_context(_team(study, job, n_workers))
        while not request.made:
            team.look_after()
            on_progress(counting(study))
            if not team.at_work and _is_complete(study, job):
                return False
            team.wait(_POLL_SECONDS)
        team.stop()
    return True


def _is_complete(study: optuna.Study, job: Job) -> bool:
    running = any(trial.state is TrialState.RUNNING for trial in counting(study))
    return not running and not is_open(study, job.n_trials)


class _Team:
    """The workers of this process."""

    def __init__(self, study: optuna.Study, job: Job, n_workers: int):
        self._study = study
        self._job = job
        self._n_workers = n_workers
        self._processes: dict[int, SpawnProcess] = {}
        self._deaths = 0
        self._finished = 0

    @property
    def at_work(self) -> bool:
        """Whether any worker is."""
        return bool(self._processes)

    def look_after(self) -> None:
        """Bury the dead, queue their trials again, and start as many as there is work for."""
        for number, process in list(self._processes.items()):
            if process.exitcode is not None:
                del self._processes[number]
                self._count_death(process)
        requeue_orphans(self._study, self._job.folder)
        if is_open(self._study, self._job.n_trials):
            for number in range(self._n_workers):
                if number not in self._processes:
                    self._processes[number] = self._start(number)

    def wait(self, seconds: float) -> None:
        """Wait until a worker ends, or for some seconds."""
        if self._processes:
            wait([process.sentinel for process in self._processes.values()], seconds)
        else:
            time.sleep(seconds)

    def stop(self) -> None:
        """Ask all workers to end, and wait until they have."""
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            process.join()

    def kill(self) -> None:
        """End all workers at once, and queue their trials again."""
        for process in self._processes.values():
            process.kill()
            process.join()
        if self._processes:
            with contextlib.suppress(StorageInternalError):  # it may be why they are killed
                requeue_orphans(self._study, self._job.folder)

    def _start(self, number: int) -> SpawnProcess:
        context = multiprocessing.get_context("spawn")
        process = context.Process(target=work, args=(self._job, number), daemon=False)
        with _ctrl_c_ignored():
            process.start()
        return process

    def _count_death(self, process: SpawnProcess) -> None:
        finished = sum(trial.state.is_finished() for trial in counting(self._study))
        if process.exitcode == 0 or finished > self._finished:
            self._deaths = 0
        self._finished = finished
        if process.exitcode == 0:
            return
        self._deaths += 1
        if self._deaths >= _MAX_DEATHS * self._n_workers:
            raise RunError(
                f"{self._deaths} workers in a row ended with {_exit(process)} before a trial was "
                f"finished; what they printed is in '{self._job.folder.workers_dir}'."
            )


@contextlib.contextmanager
def _team(study: optuna.Study, job: Job, n_workers: int) -> Iterator[_Team]:
    team = _Team(study, job, n_workers)
    try:
        yield team
    except BaseException:
        team.kill()
        raise


def _exit(process: SpawnProcess) -> str:
    code = process.exitcode
    assert code is not None, "the process has ended"
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"


@contextlib.contextmanager
def _ctrl_c_ignored() -> Iterator[None]:
    """Let a process that is started now ignore Ctrl-C until it has its own handler."""
    if threading.current_thread() is not threading.main_thread():  # Python allows no handlers there
        yield
        return
    former = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, former)
