"""The parent of a study's workers: it hands out trials, and queues those again that were lost."""

from __future__ import annotations

import platform
import secrets
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait

import optuna
from optuna.exceptions import ExperimentalWarning, StorageInternalError
from optuna.storages import fail_stale_trials
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.exceptions import RunError, one_line
from sb3_piano.interrupts import StopRequest
from sb3_piano.tuning.storage import GRACE_PERIOD, PATIENCE
from sb3_piano.tuning.trials import OWNER, counting, requeue_lost
from sb3_piano.tuning.workers import TrialJob

MAX_DEATHS = 3
"""Deaths for each worker, since a trial ended by itself, after which a study is given up."""

_POLL_SECONDS = 1.0


class Team:
    """Workers of this command, and the trials of a study that they run.

    Args:
        study: The study, as this process sees it.
        job: What a worker does to run a trial of it.
        n_trials: Trials of the study in all.
        n_workers: Trials that are run at a time.
    """

    def __init__(self, study: optuna.Study, job: TrialJob, *, n_trials: int, n_workers: int):
        self.job, self.n_trials = job, n_trials
        self._study, self._n_workers = study, n_workers
        self._owner = [platform.node(), str(job.folder.path.resolve())]
        self._busy: dict[Future[None], str] = {}  # with the names of their jobs
        self._deaths = 0  # since a job ended by itself
        self._first_seen: dict[int, float] = {}  # trials that run and do not say where

    def run(
        self,
        executor: Executor,
        request: StopRequest,
        on_progress: Callable[[Sequence[FrozenTrial]], object],
    ) -> bool:
        """Run trials until the study has all; return whether it was interrupted before.

        It has all when the trials of other machines are over, too.

        Args:
            executor: Runs the trials.
            request: Ends it when it is made.
            on_progress: Gets the trials that count.

        Raises:
            RunError: If workers die again and again without having finished a trial.
            StorageInternalError: If the database is away for too long.
        """
        last_time_well = time.monotonic()
        while not request.made:
            try:
                self.queue_lost_again()
                trials = counting(self._study)
                on_progress(trials)
                if self._is_complete(trials):
                    return False
                self._begin(executor, trials)
                last_time_well = time.monotonic()
            except StorageInternalError:
                if time.monotonic() > last_time_well + PATIENCE:
                    raise
            self._wait()
        return True

    def queue_lost_again(self, *, ended: bool = False) -> None:
        """Queue trials of ours again whose process is gone; all of them if the workers ended."""
        if ended:
            self._busy = {}
        requeue_lost(self._study, self._is_lost)

    def _left(self, trials: Sequence[FrozenTrial]) -> int:
        """Return the number of trials that have not begun."""
        waiting = sum(trial.state is TrialState.WAITING for trial in trials)
        return waiting + max(0, self.n_trials - len(trials))

    def _is_complete(self, trials: Sequence[FrozenTrial]) -> bool:
        if self._busy or self._left(trials):
            return False
        with warnings.catch_warnings():  # other machines' trials, which nobody would miss otherwise
            warnings.simplefilter("ignore", ExperimentalWarning)
            fail_stale_trials(self._study)
        return not any(trial.state is TrialState.RUNNING for trial in trials)

    def _begin(self, executor: Executor, trials: Sequence[FrozenTrial]) -> None:
        """Let workers that are free run trials. Each asks for one itself, some yet have to."""
        yet_to_ask = len(self._busy) - sum(
            trial.state is TrialState.RUNNING and self._is_run_here(trial) for trial in trials
        )
        for _ in range(min(self._n_workers - len(self._busy), self._left(trials) - yet_to_ask)):
            name = secrets.token_hex(4)
            self._busy[executor.submit(self.job, [*self._owner, name])] = name

    def _wait(self) -> None:
        """Wait for a moment, or until a worker is free."""
        if not self._busy:
            time.sleep(_POLL_SECONDS)
        for future in wait(self._busy, _POLL_SECONDS, FIRST_COMPLETED).done:
            del self._busy[future]
            error = future.exception()
            self._deaths = 0 if error is None else self._deaths + 1
            if error is not None and self._deaths >= MAX_DEATHS * self._n_workers:
                raise RunError(
                    f"{self._deaths} workers in a row ended before a trial was finished, the last "
                    f"one so: {one_line(error)} What they printed is in "
                    f"'{self.job.folder.workers_dir}'."
                )

    @property
    def _is_embedded(self) -> bool:
        return self.job.storage is None

    def _is_run_here(self, trial: FrozenTrial) -> bool:
        """Return whether a job that has not ended runs a trial, and has said so."""
        return not set(self._busy.values()).isdisjoint(trial.user_attrs.get(OWNER, ()))

    def _is_ours(self, trial: FrozenTrial) -> bool:
        """Return whether this command or one before it in this folder runs, or ran, a trial."""
        owner = trial.user_attrs.get(OWNER)
        return self._is_embedded or (owner is not None and owner[:2] == self._owner)

    def _is_lost(self, trial: FrozenTrial) -> bool:
        """Return whether a trial that runs, or failed without a reason, is ours and nobody's.

        One that runs and does not say where was asked for a moment ago, or its process was killed
        at that moment. In a database Optuna would wait for it for ever, as for any that never had a
        heartbeat.
        """
        owner = trial.user_attrs.get(OWNER)
        if owner is not None or trial.state is not TrialState.RUNNING:
            return self._is_ours(trial) and not self._is_run_here(trial)
        if self._is_embedded:
            return not self._busy
        first = self._first_seen.setdefault(trial.number, time.monotonic())
        return time.monotonic() - first > GRACE_PERIOD
