"""Workers of a study: what one does, and all of a command, which run its trials."""

from __future__ import annotations

import contextlib
import os
import platform
import secrets
import sys
import time
import warnings
from collections.abc import Collection
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass

import optuna
from optuna.exceptions import ExperimentalWarning, UpdateFinishedTrialError
from optuna.storages import fail_stale_trials
from optuna.trial import TrialState
from rich.progress import Progress

from sb3_piano.exceptions import RunError, one_line
from sb3_piano.interrupts import StopRequest, ended_as_by_ctrl_c
from sb3_piano.links import make_folder
from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.storage import opened_store
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder, make_pruner, make_sampler
from sb3_piano.tuning.trials import FAILURE, OWNER, counting, repeated, retry, summary

MAX_DEATHS = 3
"""Deaths for each worker, since a trial ended by itself, after which a study is given up."""

_POLL_SECONDS = 1.0


@dataclass(frozen=True, kw_only=True)
class TrialJob:
    """What a worker does: it runs a trial of a study."""

    config: StudyConfig
    folder: StudyFolder
    study_name: str
    storage: str | None
    search: Search

    def __call__(self, name: str) -> None:
        """Run one trial; in a database, queue its settings again if it is interrupted."""
        make_folder(self.folder.workers_dir)
        log_file = self.folder.workers_dir / f"{platform.node()}-{os.getpid()}.log"
        with log_file.open("ab") as log:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
                os.dup2(log.fileno(), stream.fileno())
        with ended_as_by_ctrl_c(), opened_store(self.storage, self.folder) as store:
            pruner = make_pruner(self.search, self.config)
            study = optuna.load_study(study_name=self.study_name, storage=store, pruner=pruner)

            def objective(trial: optuna.Trial) -> float:
                trial.set_user_attr(OWNER, name)
                study.sampler = make_sampler(self.search, trial.number)
                return Objective(self.config, self.folder)(trial)

            try:
                study.optimize(objective, n_trials=1, catch=(Exception,), gc_after_trial=True)
            except KeyboardInterrupt:
                for trial in study.get_trials(states=(TrialState.FAIL,)):
                    if trial.user_attrs.get(OWNER) == name and self.storage is not None:
                        retry(study, trial)
                raise


def run_trials(
    study: optuna.Study,
    job: TrialJob,
    executor: Executor,
    n_trials: int,
    n_workers: int,
    request: StopRequest,
    progress: Progress,
) -> bool:
    """Run trials until a study has all; return whether it was interrupted before.

    It has all when the trials of other machines are over, too.

    Raises:
        RunError: If workers die again and again without having finished a trial.
    """
    busy: dict[Future[None], str] = {}  # with the names of their jobs
    deaths, bar = 0, progress.add_task("trials", total=n_trials)
    while not request.made:
        requeue_lost(study, job, busy.values())
        trials = counting(study)
        running = [trial for trial in trials if trial.state is TrialState.RUNNING]
        elsewhere = [t for t in running if t.user_attrs.get(OWNER) not in busy.values()]
        finished = sum(trial.state.is_finished() for trial in trials)
        progress.update(bar, completed=finished, description=summary(trials, job.config.value_name))
        left = max(n_trials, len(trials)) - finished - len(elsewhere)
        for _ in range(min(n_workers, left) - len(busy)):
            name = secrets.token_hex(4)
            busy[executor.submit(job, name)] = name
        if not busy:
            # A process that was killed before it gave its name is not waited for.
            if not any(OWNER in trial.user_attrs for trial in elsewhere):
                return False
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ExperimentalWarning)
                fail_stale_trials(study)
            time.sleep(_POLL_SECONDS)
        for future in wait(busy, _POLL_SECONDS, FIRST_COMPLETED).done:
            del busy[future]
            error = future.exception()
            deaths = 0 if error is None else deaths + 1
            if error is not None and deaths >= MAX_DEATHS * n_workers:
                raise RunError(
                    f"{deaths} workers in a row ended before a trial was finished, the last one "
                    f"so: {one_line(error)} What they printed is in '{job.folder.workers_dir}'."
                )
    return True


def requeue_lost(study: optuna.Study, job: TrialJob, busy: Collection[str] = ()) -> None:
    """Queue trials of a journal again whose process is gone, or that ended without a reason.

    Those that run belong to none of the busy jobs. In a database Optuna queues them again, as their
    heartbeats are missing.
    """
    trials = study.get_trials() if job.storage is None else []
    again = repeated(trials)
    for trial in trials:
        owner, is_failed = trial.user_attrs.get(OWNER), trial.state is TrialState.FAIL
        is_run = owner in busy or (owner is None and bool(busy))  # it has just begun
        if trial.state is TrialState.RUNNING and not is_run:
            with contextlib.suppress(ValueError, UpdateFinishedTrialError):  # it has just ended
                study.tell(trial.number, state=TrialState.FAIL)
                retry(study, trial)
        elif is_failed and FAILURE not in trial.user_attrs and trial.number not in again:
            retry(study, trial)
