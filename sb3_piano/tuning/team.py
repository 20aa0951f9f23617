"""The parent of a study's workers: it asks for trials, lets workers run them, and tells."""

from __future__ import annotations

import contextlib
import platform
import time
import warnings
from collections.abc import Callable, Sequence
from multiprocessing.connection import wait
from typing import Any

import optuna
from optuna.exceptions import ExperimentalWarning, StorageInternalError, UpdateFinishedTrialError
from optuna.storages import BaseStorage, RDBStorage, fail_stale_trials
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.tuning import worker
from sb3_piano.tuning.objective import note_place
from sb3_piano.tuning.study import StudyConfig, StudyFolder
from sb3_piano.tuning.trials import FOLDER, HOST, INTERRUPTED, counting, requeue_lost
from sb3_piano.tuning.worker import Worker

_POLL_SECONDS = 1.0
_MAX_DEATHS = 3
_DATABASE_PATIENCE = 60.0
"""Seconds for which a database may be away before the study ends here."""


class Heart:
    """Heartbeats of trials in a database, by which other machines know that they run.

    Args:
        study: The study.
        storage: The database that it is in.
    """

    def __init__(self, study: optuna.Study, storage: BaseStorage):
        assert isinstance(storage, RDBStorage), "a journal has no heartbeats"
        self._study = study
        self._storage = storage
        self._next = 0.0
        self._seen: set[int] = set()

    def beat(self, trials: Sequence[optuna.Trial]) -> None:
        """Give trials of ours a heartbeat, if it is time, and fail those of others without one.

        Optuna waits for ever for a trial that never had a heartbeat, since its process was killed
        at once. So any that runs gets one the first time it is seen.
        """
        if time.monotonic() < self._next:
            return
        running = self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,))
        # Optuna itself knows trials by an id that is not public.
        ids = {trial._trial_id for trial in trials}
        ids |= {trial._trial_id for trial in running if trial.number not in self._seen}
        for trial_id in ids:
            self._storage.record_heartbeat(trial_id)
        self._seen.update(trial.number for trial in running)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExperimentalWarning)
            fail_stale_trials(self._study)
        self._next = time.monotonic() + (self._storage.get_heartbeat_interval() or 0)


class Team:
    """Workers on this machine, and the trials that they run.

    Args:
        study: The study.
        config: What it searches.
        folder: Its folder, which this process owns.
        heart: Heartbeats, if other machines may work on the study.
        n_trials: Trials of the study in all.
        n_workers: Workers at most.
    """

    def __init__(
        self,
        study: optuna.Study,
        config: StudyConfig,
        folder: StudyFolder,
        *,
        heart: Heart | None,
        n_trials: int,
        n_workers: int,
    ):
        self._study = study
        self._config = config
        self._folder = folder
        self._heart = heart
        self._n_trials = n_trials
        self._n_workers = n_workers
        self._workers: list[Worker] = []
        self._deaths = 0  # since the last trial that ended by itself

    def run(self, on_progress: Callable[[Sequence[FrozenTrial]], object]) -> bool:
        """Run trials until the study has all; return whether it was interrupted.

        It is over when the trials of other machines are over, too. Ctrl-C and SIGTERM end the
        workers, whose trials are queued again.

        Args:
            on_progress: Is called with the trials that count.

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
                        on_progress(counting(self._study))
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
            for one in self._workers:
                one.kill()

    def _adopt(self) -> None:
        """Fail trials of a process that ran this study here before and is gone; queue them."""
        for trial in self._study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            if self._is_ours(trial):
                self._study.tell(trial.number, state=TrialState.FAIL, skip_if_finished=True)
        requeue_lost(self._study, self._is_ours)

    def _is_ours(self, trial: FrozenTrial) -> bool:
        """Return whether the owner of this folder runs, or ran, a trial."""
        noted = (trial.user_attrs.get(HOST), trial.user_attrs.get(FOLDER))
        here = (platform.node(), str(self._folder.trial_dir(trial.number)))
        return self._heart is None or noted == here

    def _is_complete_after_step(self) -> bool:
        """Begin trials and pass on what workers say; return whether the study is complete."""
        if self._heart is not None:
            self._heart.beat([one.trial for one in self._workers if one.trial is not None])
        while len(self._busy) < self._n_workers and self._is_open:
            self._begin_trial()
        if self._busy:
            left_over = any(one.said is not None for one in self._busy)
            ready = wait([one.connection for one in self._busy], 0 if left_over else _POLL_SECONDS)
            for one in self._busy:
                if one.said is not None or one.connection in ready:
                    self._hear(one)
            return False
        if not any(trial.state is TrialState.RUNNING for trial in counting(self._study)):
            return not self._is_open
        time.sleep(_POLL_SECONDS)  # on other machines
        return False

    @property
    def _busy(self) -> list[Worker]:
        return [one for one in self._workers if one.trial is not None]

    @property
    def _is_open(self) -> bool:
        """Whether there is a trial to begin: one that waits, or one that is yet to be made."""
        trials = counting(self._study)
        waiting = any(trial.state is TrialState.WAITING for trial in trials)
        return waiting or len(trials) < self._n_trials

    def _begin_trial(self) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Heartbeat of storage is supposed", UserWarning)
            trial = self._study.ask()
        note_place(trial, self._folder)
        self._config.space.suggest(trial)
        idle = next((one for one in self._workers if one.trial is None), None)
        if idle is None:
            idle = Worker(self._config, self._folder)
            self._workers.append(idle)
        idle.begin(trial)

    def _hear(self, one: Worker) -> None:
        """Pass on all that a worker has said, or notice that it has died."""
        try:
            while one.trial is not None and (one.said or one.connection.poll()):
                one.said = one.said or one.connection.recv()
                self._pass_on(one.said, one, one.trial)
                one.said = None  # not before it is in the store
        except (EOFError, ConnectionError):
            self._replace(one)
        except UpdateFinishedTrialError:  # given to another machine, as no heartbeat had come
            one.kill()
            self._workers.remove(one)

    def _pass_on(self, said: tuple[Any, ...], one: Worker, trial: optuna.Trial) -> None:
        match said:
            case worker.REPORT, value, step:
                trial.report(value, step)
                one.connection.send(trial.should_prune())
                return
            case worker.NOTE, name, value:
                trial.set_user_attr(name, value)
                return
            case worker.COMPLETE, value:
                self._study.tell(trial, value, skip_if_finished=True)
            case (worker.PRUNED,):
                self._study.tell(trial, state=TrialState.PRUNED, skip_if_finished=True)
            case _:
                self._study.tell(trial, state=TrialState.FAIL, skip_if_finished=True)
        one.trial, self._deaths = None, 0

    def _replace(self, one: Worker) -> None:
        """Queue the trial of a dead worker again; another worker will take it.

        Raises:
            RunError: If too many died.
        """
        how = one.kill()
        assert one.trial is not None, "only busy workers are heard"
        self._study.tell(one.trial, state=TrialState.FAIL, skip_if_finished=True)
        requeue_lost(self._study, self._is_ours)
        self._workers.remove(one)
        self._deaths += 1
        if self._deaths >= _MAX_DEATHS * self._n_workers:
            raise RunError(
                f"{self._deaths} workers in a row ended with {how} before a trial was finished; "
                f"what they printed is in '{self._folder.workers_dir}'."
            )

    def _interrupt(self) -> None:
        """End all workers at once, and queue their trials again."""
        for one in self._busy:
            self._hear(one)  # what is finished is not lost
        for one in self._busy:
            one.kill()
            assert one.trial is not None, "it is busy"
            with contextlib.suppress(UpdateFinishedTrialError):
                one.trial.set_user_attr(INTERRUPTED, True)
            self._study.tell(one.trial, state=TrialState.FAIL, skip_if_finished=True)
        requeue_lost(self._study, self._is_ours)
