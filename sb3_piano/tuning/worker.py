"""A worker: a process that runs trials of a study, one after the other."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import platform
import signal
import sys
import threading
import zlib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import optuna
from optuna.trial import TrialState

from sb3_piano.interrupts import StopRequest, stop_on_signal
from sb3_piano.locks import hold
from sb3_piano.tuning.attributes import WORKER, counting
from sb3_piano.tuning.objective import Objective, TrialInterrupted
from sb3_piano.tuning.samplers import Search, make_pruner, make_sampler
from sb3_piano.tuning.store.locks import worker_lock
from sb3_piano.tuning.store.orphans import requeue_interrupted, requeue_orphans
from sb3_piano.tuning.store.storage import open_storage
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder


@dataclass(frozen=True, kw_only=True)
class Job:
    """What a worker has to do."""

    name: str
    """The study's name in its store."""
    config: StudyConfig
    """The study."""
    folder: StudyFolder
    """Its folder on this machine."""
    n_trials: int
    """Trials that the study is to have in all, by whatever workers."""
    storage: str | None = field(default=None, repr=False)  # it may hold a password
    """URL of the database; by default the study's journal."""
    search: Search = field(default_factory=Search)
    """How settings are chosen and trials ended early."""

    def load_study(self, worker: int) -> optuna.Study:
        """Return the study, which must be there.

        Args:
            worker: The number of the worker on this machine. No two samplers draw alike: neither
                those of two workers, nor that of a worker that takes the place of another.
        """
        study = optuna.load_study(
            study_name=self.name,
            storage=open_storage(self.storage, self.folder),
            pruner=make_pruner(self.search, self.config),
        )
        machine = 0 if self.storage is None else zlib.crc32(platform.node().encode())
        entropy = (machine, worker, len(study.get_trials(deepcopy=False)))
        draws = np.random.SeedSequence(entropy).generate_state(1)[0]
        study.sampler = make_sampler(self.search, int(draws))
        return study


def work(job: Job, number: int) -> None:
    """Run trials until the study has as many as it is to have; the target of a process.

    SIGINT and SIGTERM end the trial that runs, whose settings are queued again; so does the end of
    the process that started this one.
    """
    os.setpgrp()  # Ctrl-C on the terminal is for the process that watches over the workers
    with stop_on_signal() as request, worker_lock(job.folder) as name:
        threading.Thread(target=_stop_with_parent, daemon=True).start()
        _redirect_output(job.folder.workers_dir / f"{name}.log")
        study = job.load_study(number)
        while not request.made:
            if not run_trial(study, job, name, request):
                return


def _stop_with_parent() -> None:
    """Ask this process to stop once the one that started it is gone, however it died."""
    parent = multiprocessing.parent_process()
    assert parent is not None, "a worker is started by another process"
    parent.join()
    signal.raise_signal(signal.SIGTERM)


def run_trial(study: optuna.Study, job: Job, worker: str, request: StopRequest) -> bool:
    """Run one trial, if the study is to have another one; return whether it may go on.

    On one machine it never gets more trials than it is to have. Several machines that ask in the
    same moment may each begin a last one.
    """
    claim = contextlib.ExitStack()
    with claim:
        claim.enter_context(hold(job.folder.workers_dir / "claim.lock"))
        requeue_orphans(study, job.folder)
        if not is_open(study, job.n_trials):
            return False
        objective = Objective(job.config, job.folder, worker, on_start=claim.close)
        try:
            # Models refer to themselves: without a collection their memory would pile up.
            study.optimize(objective, n_trials=1, catch=(Exception,), gc_after_trial=True)
        except TrialInterrupted:
            requeue_interrupted(study, _last_of(study, worker))
            request.made = True
    return True


def is_open(study: optuna.Study, n_trials: int) -> bool:
    """Return whether there is a trial to begin: one that waits, or one that is yet to be made."""
    trials = counting(study)
    waiting = any(trial.state is TrialState.WAITING for trial in trials)
    return waiting or len(trials) < n_trials


def _last_of(study: optuna.Study, worker: str) -> optuna.trial.FrozenTrial:
    trials = study.get_trials(deepcopy=False)
    return [trial for trial in trials if trial.user_attrs.get(WORKER) == worker][-1]


def _redirect_output(file: Path) -> None:
    """Let everything that this process prints, libraries included, go to a file."""
    with file.open("ab") as log:
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
            os.dup2(log.fileno(), stream.fileno())
