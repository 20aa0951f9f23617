"""Run a study with one or more processes and machines."""

from __future__ import annotations

import contextlib
import os
import platform
import secrets
import sys
import time
from collections.abc import Collection
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.exceptions import UpdateFinishedTrialError
from optuna.storages import fail_stale_trials
from optuna.trial import FrozenTrial, TrialState
from rich.console import Console
from rich.progress import Progress

from sb3_piano.exceptions import RunError, one_line
from sb3_piano.interrupts import StopRequest, ended_as_by_ctrl_c, stop_on_signal
from sb3_piano.jobs import Resources, open_executor
from sb3_piano.links import keep_inside, make_folder
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.settings import Count, checked
from sb3_piano.tuning import study as of_study
from sb3_piano.tuning.objective import Objective
from sb3_piano.tuning.space import check_space
from sb3_piano.tuning.storage import open_study, opened_store
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder

MAX_DEATHS = 3  # in a row, of each worker, after which a study is aborted
_POLL_SECONDS = 1.0


@dataclass(frozen=True, kw_only=True)
class TuneResult:
    """The state of a study."""

    folder: StudyFolder
    """Folder of all files."""
    study: optuna.Study
    """Optuna's study object."""
    trials: tuple[FrozenTrial, ...]
    """All trials except repeated ones."""
    interrupted: bool
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def best(self) -> FrozenTrial | None:
        """The best trial; ``None`` if none is complete."""
        return next(iter(of_study.best_first(self.trials)), None)


def tune(
    config: StudyConfig,
    folder: str | os.PathLike[str],
    *,
    name: str | None = None,
    n_trials: int = 20,
    workers: int = 1,
    ray: str | None = None,
    storage: str | None = None,
    search: Search = Search(),  # noqa: B008 - frozen
    progress_bar: bool = True,
) -> TuneResult:
    """Run a study, or resume it, until it has all its trials.

    The first trial has the settings of ``config.entry`` that are in the space. Failed trials count;
    settings of a trial that was interrupted, or whose process died, are queued again. The best
    settings, a table and a report are written at the end, also after Ctrl-C; the same call then
    resumes. On several machines, call this on each with the same settings and the URL of one
    database; every call returns when the whole study is complete.

    Args:
        config: Search space and evaluation.
        folder: The study's folder on this machine; created if missing.
        name: Name of the study in its store; by default the folder's name.
        n_trials: Total number of trials of the study.
        workers: Processes that run trials; on this machine they share the cores.
        ray: Address of a Ray cluster, see :func:`~sb3_piano.jobs.open_executor`; the workers then
            run there, with one core each. All nodes see ``folder`` by the same path, on a disk with
            locks, or reach the database.
        storage: URL of a database, such as ``postgresql+psycopg://user@host/name``; by default
            the study is kept in its folder.
        search: Sampler and pruner of the study.
        progress_bar: Whether to show progress on the terminal.

    Raises:
        ConfigError: If a setting is unknown or out of range, or another program's study has the
            name.
        RunError: If folder or store cannot be used, the study exists with other settings, another
            process runs the study in this folder, or workers die again and again.
    """
    checked("n_trials", n_trials, Count)
    checked("workers", workers, Count)
    place = StudyFolder(Path(folder))
    keep_inside(place.path)
    check_space(config.space, config.algo, config.env_id, config.entry)
    name = place.path.resolve().name if name is None else name
    there = StudyFolder(place.path.absolute())  # workers may have another working directory
    job = _TrialJob(config=config, folder=there, study_name=name, storage=storage, search=search)
    # Machines that share a disk and work on one study in a database may also share its folder, as
    # no trial runs on two machines.
    lock = place.workers_dir / f"{'study' if storage is None else platform.node()}{LOCK_SUFFIX}"
    owned = hold(lock, f"Study '{place.path}' is being run", "one command in a folder: --workers.")
    with stop_on_signal() as request, owned, opened_store(storage, place) as store:
        study = open_study(config, store, name=name, search=search)
        with (
            Progress(console=Console(stderr=True), disable=not progress_bar) as progress,
            # The settings of a lost trial are queued again, not its job.
            open_executor(None if ray else workers, ray, Resources(retries=0)) as executor,
        ):
            interrupted = _run_trials(study, job, executor, n_trials, workers, request, progress)
        _requeue_lost(study, job)
        from sb3_piano.tuning.report import write_best, write_report, write_table

        for write in (write_best, write_table, write_report):
            write(study, config, place)
        trials = tuple(of_study.counting(study))
        return TuneResult(folder=place, study=study, trials=trials, interrupted=interrupted)


@dataclass(frozen=True, kw_only=True)
class _TrialJob:
    """Worker-side job that runs a trial of a study."""

    config: StudyConfig
    folder: StudyFolder
    study_name: str
    storage: str | None
    search: Search

    def __call__(self, name: str) -> None:
        """Run one trial; if it is interrupted, queue its settings again in a database."""
        make_folder(self.folder.workers_dir)
        log_file = self.folder.workers_dir / f"{platform.node()}-{os.getpid()}.log"
        with log_file.open("ab") as log:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
                os.dup2(log.fileno(), stream.fileno())
        with ended_as_by_ctrl_c(), opened_store(self.storage, self.folder) as store:
            pruner = of_study.make_pruner(self.search, self.config)
            study = optuna.load_study(study_name=self.study_name, storage=store, pruner=pruner)

            def objective(trial: optuna.Trial) -> float:
                trial.set_user_attr(of_study.OWNER, name)
                study.sampler = of_study.make_sampler(self.search, trial.number)
                return Objective(self.config, self.folder)(trial)

            try:
                study.optimize(objective, n_trials=1, catch=(Exception,), gc_after_trial=True)
            except KeyboardInterrupt:
                for trial in study.get_trials(states=(TrialState.FAIL,)):
                    if trial.user_attrs.get(of_study.OWNER) == name and self.storage is not None:
                        of_study.retry(study, trial)
                raise


def _run_trials(
    study: optuna.Study,
    job: _TrialJob,
    executor: Executor,
    n_trials: int,
    n_workers: int,
    request: StopRequest,
    progress: Progress,
) -> bool:
    """Run trials until a study has all, counting other machines'; return whether interrupted."""
    busy: dict[Future[None], str] = {}  # values are the names of their jobs
    deaths, bar = 0, progress.add_task("trials", total=n_trials)
    while not request.made:
        _requeue_lost(study, job, busy.values())
        trials = of_study.counting(study)
        running = [trial for trial in trials if trial.state is TrialState.RUNNING]
        elsewhere = [t for t in running if t.user_attrs.get(of_study.OWNER) not in busy.values()]
        finished = sum(trial.state.is_finished() for trial in trials)
        text = of_study.summary(trials, job.config.value_name)
        progress.update(bar, completed=finished, description=text)
        left = max(n_trials, len(trials)) - finished - len(elsewhere)
        for _ in range(min(n_workers, left) - len(busy)):
            name = secrets.token_hex(4)
            busy[executor.submit(job, name)] = name
        if not busy:
            # Do not wait for a process that was killed before it gave its name.
            if not any(of_study.OWNER in trial.user_attrs for trial in elsewhere):
                return False
            with of_study.optuna_experiments():
                fail_stale_trials(study)
            time.sleep(_POLL_SECONDS)
        for future in wait(busy, _POLL_SECONDS, FIRST_COMPLETED).done:
            del busy[future]
            error = future.exception()
            deaths = 0 if error is None else deaths + 1
            if error is not None and deaths >= MAX_DEATHS * n_workers:
                raise RunError(
                    f"{deaths} workers in a row ended before a trial was finished, the last one "
                    f"so: {one_line(error)} Their output is in '{job.folder.workers_dir}'."
                )
    return True


def _requeue_lost(study: optuna.Study, job: _TrialJob, busy: Collection[str] = ()) -> None:
    """Queue trials of a journal again if they are lost or ended without a reason.

    In a database Optuna does this after missing heartbeats.
    """
    trials = study.get_trials() if job.storage is None else []
    again = of_study.repeated(trials)
    for trial in trials:
        owner, failed = trial.user_attrs.get(of_study.OWNER), trial.state is TrialState.FAIL
        is_run = owner in busy or (owner is None and bool(busy))  # it has just begun
        if trial.state is TrialState.RUNNING and not is_run:
            with contextlib.suppress(ValueError, UpdateFinishedTrialError):  # it has just ended
                of_study.retry(study, study.tell(trial.number, state=TrialState.FAIL))
        elif failed and of_study.FAILURE not in trial.user_attrs and trial.number not in again:
            of_study.retry(study, trial)
