"""The parent of a study's workers: it asks for trials, they run them, and it tells."""

from __future__ import annotations

import contextlib
import platform
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, field
from multiprocessing.connection import wait
from typing import Any

import optuna
from optuna.exceptions import ExperimentalWarning, StorageInternalError, UpdateFinishedTrialError
from optuna.storages import RDBStorage, fail_stale_trials
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.tuning.objective import note_place
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.tuning.trials import INTERRUPTED, OWNER, counting, requeue_lost
from sb3_piano.tuning.workers import MakeWorker, ProcessWorker, Worker

_POLL_SECONDS = 1.0
_MAX_DEATHS = 3
_DATABASE_PATIENCE = 60.0
"""Seconds for which a database may be away before the study ends here."""


@dataclass
class Heart:
    """Heartbeats of trials in a database, by which other machines know that they run."""

    study: optuna.Study
    storage: RDBStorage
    """The database that it is in."""
    _next: float = field(default=0.0, init=False)
    _seen: set[int] = field(default_factory=set, init=False)

    def beat(self, trials: Sequence[optuna.Trial]) -> None:
        """Give trials of ours a heartbeat, if it is time, and fail those of others without one.

        Optuna waits for ever for a trial that never had a heartbeat, since its process was killed
        at once. So any that runs gets one the first time it is seen.
        """
        if time.monotonic() < self._next:
            return
        running = self.study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
        # Optuna itself knows trials by an id that is not public.
        new = {trial._trial_id for trial in running if trial.number not in self._seen}
        for trial_id in new | {trial._trial_id for trial in trials}:
            self.storage.record_heartbeat(trial_id)
        self._seen.update(trial.number for trial in running)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            fail_stale_trials(self.study)
        self._next = time.monotonic() + (self.storage.get_heartbeat_interval() or 0)


@dataclass
class Team:
    """Workers of this command, and the trials that they run."""

    study: optuna.Study
    config: StudyConfig
    folder: StudyFolder
    """Folder of the study, which this process owns."""
    _: KW_ONLY
    heart: Heart | None
    """Heartbeats, if other machines may work on the study."""
    n_trials: int
    """Trials of the study in all."""
    n_workers: int
    """Workers at most."""
    make_worker: MakeWorker = ProcessWorker
    """Makes a worker."""
    _workers: list[Worker] = field(default_factory=list, init=False)
    _deaths: int = field(default=0, init=False)  # since the last trial that ended by itself

    def run(self, on_progress: Callable[[Sequence[FrozenTrial]], object]) -> bool:
        """Run trials until the study has all; return whether it was interrupted.

        It is over when the trials of other machines are over, too. Ctrl-C and SIGTERM end the
        workers, whose trials are queued again. ``on_progress`` gets the trials that count.

        Raises:
            RunError: If workers die again and again without having finished a trial.
            StorageInternalError: If the database is away for too long.
        """
        try:
            with stop_on_signal() as request:
                self._adopt()
                last_time_well = time.monotonic()
                while not request.made:
                    try:
                        on_progress(counting(self.study))
                        if self._is_complete_after_step():
                            return False
                        last_time_well = time.monotonic()
                    except StorageInternalError:
                        if time.monotonic() > last_time_well + _DATABASE_PATIENCE:
                            raise
                        time.sleep(_POLL_SECONDS)
                self._interrupt()
            return True
        finally:
            for worker in self._workers:
                worker.kill()

    def _adopt(self) -> None:
        """Fail trials of a process that ran this study here before and is gone; queue them."""
        for trial in self.study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            if self._is_ours(trial):
                self._fail(trial.number)
        requeue_lost(self.study, self._is_ours)

    def _is_ours(self, trial: FrozenTrial) -> bool:
        """Return whether the owner of this folder runs, or ran, a trial."""
        return self.heart is None or trial.user_attrs.get(OWNER) == self._owner

    @property
    def _owner(self) -> list[str]:
        return [platform.node(), str(self.folder.path.resolve())]

    def _fail(self, trial: optuna.Trial | int) -> None:
        self.study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)

    def _is_complete_after_step(self) -> bool:
        """Begin trials and pass on what workers say; return whether the study is complete."""
        if self.heart is not None:
            self.heart.beat([worker.trial for worker in self._workers if worker.trial is not None])
        while len(self._busy) < self.n_workers and self._is_open:
            self._begin_trial()
        if self._busy:
            left_over = any(worker.said is not None for worker in self._busy)
            connections = [worker.connection for worker in self._busy]
            ready = wait(connections, 0 if left_over else _POLL_SECONDS)
            for worker in self._busy:
                if worker.said is not None or worker.connection in ready:
                    self._hear(worker)
            return False
        if not any(trial.state is TrialState.RUNNING for trial in counting(self.study)):
            return not self._is_open
        time.sleep(_POLL_SECONDS)  # on other machines
        return False

    @property
    def _busy(self) -> list[Worker]:
        return [worker for worker in self._workers if worker.trial is not None]

    @property
    def _is_open(self) -> bool:
        """Whether there is a trial to begin: one that waits, or one that is yet to be made."""
        trials = counting(self.study)
        waiting = any(trial.state is TrialState.WAITING for trial in trials)
        return waiting or len(trials) < self.n_trials

    def _begin_trial(self) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Heartbeat of storage is supposed", UserWarning)
            trial = self.study.ask()
        note_place(trial, self.folder)
        trial.set_user_attr(OWNER, self._owner)
        self.config.space.suggest(trial)
        idle = next((worker for worker in self._workers if worker.trial is None), None)
        if idle is None:
            idle = self.make_worker(self.config, self.folder)
            self._workers.append(idle)
        idle.begin(trial)

    def _hear(self, worker: Worker) -> None:
        """Pass on all that a worker has said, or notice that it has died."""
        try:
            while worker.trial is not None and (worker.said or worker.connection.poll()):
                worker.said = worker.said or worker.connection.recv()
                self._pass_on(worker.said, worker, worker.trial)
                worker.said = None  # not before it is in the store
        except (EOFError, ConnectionError):
            self._replace(worker)
        except UpdateFinishedTrialError:  # given to another machine, as no heartbeat had come
            worker.kill()
            self._workers.remove(worker)

    def _pass_on(self, said: tuple[Any, ...], worker: Worker, trial: optuna.Trial) -> None:
        match said:
            case "report", value, step:
                trial.report(value, step)
                worker.send(trial.should_prune())
                return
            case "note", name, value:
                trial.set_user_attr(name, value)
                return
            case "complete", value:
                self.study.tell(trial, value, skip_if_finished=True)
            case ("pruned",):
                self.study.tell(trial, state=TrialState.PRUNED, skip_if_finished=True)
            case _:
                self._fail(trial)
        worker.trial, self._deaths = None, 0

    def _replace(self, worker: Worker) -> None:
        """Queue the trial of a dead worker again; another worker will take it.

        Raises:
            RunError: If too many died.
        """
        how = worker.kill()
        assert worker.trial is not None, "only busy workers are heard"
        self._fail(worker.trial)
        requeue_lost(self.study, self._is_ours)
        self._workers.remove(worker)
        self._deaths += 1
        if self._deaths >= _MAX_DEATHS * self.n_workers:
            raise RunError(
                f"{self._deaths} workers in a row ended with {how} before a trial was finished; "
                f"what they printed is in '{self.folder.workers_dir}'."
            )

    def _interrupt(self) -> None:
        """End all workers at once, and queue their trials again."""
        for worker in self._busy:
            self._hear(worker)  # what is finished is not lost
        for worker in self._busy:
            worker.kill()
            assert worker.trial is not None, "it is busy"
            with contextlib.suppress(UpdateFinishedTrialError):
                worker.trial.set_user_attr(INTERRUPTED, True)
            self._fail(worker.trial)
        requeue_lost(self.study, self._is_ours)
