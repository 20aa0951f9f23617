"""A study from its settings to the best ones, on as many processes and machines as there are."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.trial import FrozenTrial
from rich.console import Console
from rich.progress import Progress

from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Resources, open_executor
from sb3_piano.links import keep_inside
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.settings import Count, checked
from sb3_piano.tuning.space import check_space
from sb3_piano.tuning.storage import open_study, opened_store
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder
from sb3_piano.tuning.trials import best_first, counting
from sb3_piano.tuning.workers import TrialJob, requeue_lost, run_trials


@dataclass(frozen=True, kw_only=True)
class TuneResult:
    """The state of a study."""

    folder: StudyFolder
    """Folder of all files."""
    study: optuna.Study
    """Optuna's own view of it."""
    trials: tuple[FrozenTrial, ...]
    """All trials, without those that were repeated."""
    interrupted: bool
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def best(self) -> FrozenTrial | None:
        """The best trial; ``None`` if none is complete."""
        return next(iter(best_first(self.trials)), None)


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
    """Run a study, or go on with one, until it has all its trials.

    The first trial has the settings of ``config.entry``, as far as the space holds them, so that
    the study's best is never worse than what one had before. Trials that fail count; settings of a
    trial whose process was killed, or that was interrupted, are queued again. The best settings, a
    table and a report are written in the end, after Ctrl-C too; the same call then goes on.

    On several machines, each calls this with the same settings and the URL of one database. It
    returns when the whole study is complete.

    Args:
        config: What is searched, and how it is judged.
        folder: The study's folder on this machine; it is made.
        name: The study's name in its store; by default that of the folder.
        n_trials: Trials of the study in all, at least 1.
        workers: Processes that run trials, at least 1; on this machine they share the cores.
        ray: Address of a cluster of Ray, see :func:`~sb3_piano.jobs.open_executor`; the workers
            are then there, with a core each. All nodes see ``folder`` by the same path, on a disk
            with locks, or reach the database.
        storage: URL of a database, such as ``postgresql+psycopg://user@host/name``; by default
            the study is kept in its folder.
        search: How settings are chosen and trials are ended early.
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
    there = StudyFolder(place.path.absolute())  # where workers may have another present folder
    job = TrialJob(config=config, folder=there, study_name=name, storage=storage, search=search)
    # A folder with a journal has one owner. Machines that share a disk and work on one study in a
    # database may also share the study's folder, as no trial is on two of them.
    lock = place.workers_dir / f"{'study' if storage is None else platform.node()}{LOCK_SUFFIX}"
    owned = hold(lock, f"Study '{place.path}' is being run", "one command in a folder: --workers.")
    with stop_on_signal() as request, owned, opened_store(storage, place) as store:
        study = open_study(config, store, name=name, search=search)
        with (
            Progress(console=Console(stderr=True), disable=not progress_bar) as progress,
            # The settings of a lost trial are queued again, not its job.
            open_executor(None if ray else workers, ray, Resources(retries=0)) as executor,
        ):
            interrupted = run_trials(study, job, executor, n_trials, workers, request, progress)
        requeue_lost(study, job)
        from sb3_piano.tuning.report import write_best, write_report, write_table

        for write in (write_best, write_table, write_report):
            write(study, config, place)
        trials = tuple(counting(study))
        return TuneResult(folder=place, study=study, trials=trials, interrupted=interrupted)
