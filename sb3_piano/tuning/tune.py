"""A study from its settings to the best ones, on as many processes and machines as there are."""

from __future__ import annotations

import contextlib
import os
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.exceptions import StorageInternalError
from optuna.trial import FrozenTrial, TrialState

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.tuning.attributes import FAILURE, counting
from sb3_piano.tuning.outcome.best import best_trial, preset_trial, write_best
from sb3_piano.tuning.outcome.report import write_report
from sb3_piano.tuning.outcome.table import write_table
from sb3_piano.tuning.progress import progress_bar as progress_bar_of
from sb3_piano.tuning.samplers import Search
from sb3_piano.tuning.store.database import why_refused
from sb3_piano.tuning.store.storage import open_study
from sb3_piano.tuning.study_config import StudyConfig
from sb3_piano.tuning.study_folder import StudyFolder
from sb3_piano.tuning.supervisor import supervise
from sb3_piano.tuning.worker import Job


@dataclass(frozen=True, kw_only=True)
class TuneResult:
    """How a study stands."""

    folder: StudyFolder
    """Where everything is."""
    study: optuna.Study
    """Optuna's own view of it."""
    best: FrozenTrial | None
    """The best trial; ``None`` if none is complete."""
    preset: FrozenTrial | None
    """The trial with the settings from which the study departs, if it is complete."""
    trials: tuple[FrozenTrial, ...]
    """All trials, without those that were repeated."""
    interrupted: bool
    """Whether Ctrl-C or SIGTERM ended it early."""

    @property
    def failures(self) -> set[str]:
        """Why trials failed."""
        failed = (trial for trial in self.trials if trial.state is TrialState.FAIL)
        return {trial.user_attrs.get(FAILURE, "unknown") for trial in failed}


def tune(
    config: StudyConfig,
    folder: str | os.PathLike[str],
    *,
    name: str | None = None,
    n_trials: int = 20,
    workers: int = 1,
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
        workers: Processes on this machine that run trials, at least 1; they share the cores.
        storage: URL of a database, such as ``postgresql+psycopg://user@host/name``; by default
            the study is kept in its folder.
        search: How settings are chosen and trials are ended early.
        progress_bar: Whether to show progress on the terminal.

    Raises:
        ConfigError: If a setting is unknown or out of range, or the study exists with others.
        RunError: If folder or store cannot be used, or workers die again and again.
    """
    for what, value in (("n_trials", n_trials), ("workers", workers)):
        if value < 1:
            raise ConfigError(f"{what} is {value}: expected 1 or more.")
    place = StudyFolder(Path(folder))
    config.space.check(config.algo, config.env_id, config.entry)
    _make(place)
    name = place.path.resolve().name if name is None else name
    study = open_study(config, place, name=name, url=storage, search=search)
    _check_runs(study, place)
    job = Job(
        name=name,
        config=config,
        folder=place,
        n_trials=n_trials,
        storage=storage,
        search=search,
    )
    label = f"{config.objective} {config.metric}"
    bar = progress_bar_of(n_trials, label) if progress_bar else contextlib.nullcontext()
    try:
        with bar as on_progress:
            options = {} if on_progress is None else {"on_progress": on_progress}
            interrupted = supervise(study, job, workers, **options)
        return _finished(study, config, place, interrupted)
    except StorageInternalError as error:
        raise RunError(
            f"The database of study {name!r} cannot be used any more: {why_refused(error)}. What "
            "is in it stays: when it is back, the same command goes on."
        ) from error


def _make(folder: StudyFolder) -> None:
    try:
        folder.workers_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(
            f"Folder '{folder.path}' cannot be made: {error.strerror}. Expected a place in which "
            "files can be made."
        ) from error


def _check_runs(study: optuna.Study, folder: StudyFolder) -> None:
    """Refuse a folder in which another study's runs would be in the way of this one's."""
    begun = any(trial.state is not TrialState.WAITING for trial in study.get_trials(deepcopy=False))
    if not begun and any(folder.path.glob("trials/*")):
        raise RunError(
            f"'{folder.path}' has runs of trials, but its study has none: they are another "
            "study's. Expected a new folder, or that of the study."
        )


def _finished(
    study: optuna.Study, config: StudyConfig, folder: StudyFolder, interrupted: bool
) -> TuneResult:
    write_best(study, config, folder)
    write_table(study, config, folder)
    write_report(study, config, folder)
    return TuneResult(
        folder=folder,
        study=study,
        best=best_trial(study),
        preset=preset_trial(study),
        trials=tuple(counting(study)),
        interrupted=interrupted,
    )
