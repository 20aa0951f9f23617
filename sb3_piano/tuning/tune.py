"""A study from its settings to the best ones, on as many processes and machines as there are."""

from __future__ import annotations

import contextlib
import os
import platform
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import optuna
from optuna.exceptions import StorageInternalError
from optuna.trial import FrozenTrial, TrialState
from rich.console import Console
from rich.progress import Progress

from sb3_piano.exceptions import RunError
from sb3_piano.interrupts import stop_on_signal
from sb3_piano.jobs import Resources, open_executor
from sb3_piano.links import keep_inside
from sb3_piano.locks import LOCK_SUFFIX, hold
from sb3_piano.settings import Count, checked
from sb3_piano.tuning.best import write_best
from sb3_piano.tuning.space import check_space
from sb3_piano.tuning.storage import open_study, opened_store, why_refused
from sb3_piano.tuning.study import Search, StudyConfig, StudyFolder
from sb3_piano.tuning.team import Team
from sb3_piano.tuning.trials import best_trial, counting, failure_of, preset_trial, summary
from sb3_piano.tuning.workers import TrialJob


@dataclass(frozen=True, kw_only=True)
class TuneResult:
    """The state of a study."""

    folder: StudyFolder
    """Folder of all files."""
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
        return {reason for reason in map(failure_of, self.trials) if reason is not None}


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
        ray: Address of a cluster of Ray, see :func:`~sb3_piano.jobs.connected_to_ray`; the
            workers are then there, with a core each. All nodes see ``folder`` by the same path,
            on a disk with locks, or reach the database.
        storage: URL of a database, such as ``postgresql+psycopg://user@host/name``; by default
            the study is kept in its folder.
        search: How settings are chosen and trials are ended early.
        progress_bar: Whether to show progress on the terminal.

    Raises:
        ConfigError: If a setting is unknown or out of range, or the study exists with others.
        RunError: If folder or store cannot be used, another process runs the study in this folder,
            or workers die again and again.
    """
    checked("n_trials", n_trials, Count)
    checked("workers", workers, Count)
    place = StudyFolder(Path(folder))
    keep_inside(place.path)
    check_space(config.space, config.algo, config.env_id, config.entry)
    name = Path(os.path.realpath(place.path)).name if name is None else name
    job = TrialJob(
        config=config,
        folder=place if ray is None else StudyFolder(place.path.absolute()),
        study_name=name,
        storage=storage,
        search=search,
    )
    with _owned(place, storage), opened_store(storage, place) as store:
        try:
            study = open_study(config, store, name=name, search=search)
            _check_runs(study, place)
            team = Team(study, job, n_trials=n_trials, n_workers=workers)
            with stop_on_signal() as request, _progress_bar(team, shown=progress_bar) as show:
                with _executor_of(workers, ray) as executor:
                    interrupted = team.run(executor, request, show)
                team.queue_lost_again(ended=True)
            _write_files(study, config, place)
            return TuneResult(
                folder=place,
                study=study,
                best=best_trial(study),
                preset=preset_trial(study),
                trials=tuple(counting(study)),
                interrupted=interrupted,
            )
        except StorageInternalError as error:
            raise RunError(
                f"The database of study {name!r} cannot be used any more: {why_refused(error)}. "
                "What is in it stays: when it is back, the same command goes on."
            ) from error


def _executor_of(workers: int, ray: str | None) -> AbstractContextManager[Executor]:
    """Return what runs trials. The settings of a lost one are queued again, not its job."""
    if ray is None:
        return open_executor(workers)
    return open_executor(None, ray, Resources(retries=0))


@contextlib.contextmanager
def _owned(folder: StudyFolder, storage: str | None) -> Iterator[None]:
    """Keep other processes from running the study in this folder; all may read it meanwhile.

    A folder with a journal has one owner. Machines that share a disk and work on one study in a
    database may also share the study's folder, as no trial is on two of them.
    """
    name = "study" if storage is None else platform.node()
    expected = "one command in a folder. For more processes give that one more --workers, once it "
    expected += "has ended or was stopped."
    busy = f"Study '{folder.path}' is being run"
    with hold(folder.workers_dir / f"{name}{LOCK_SUFFIX}", busy, expected):
        yield


def _check_runs(study: optuna.Study, folder: StudyFolder) -> None:
    """Refuse a folder in which another study's runs would be in the way of this one's."""
    begun = any(trial.state is not TrialState.WAITING for trial in study.get_trials(deepcopy=False))
    if not begun and any(folder.path.glob("trials/*")):
        raise RunError(
            f"'{folder.path}' has runs of trials, but its study has none: they are another "
            "study's. Expected a new folder, or that of the study."
        )


@contextlib.contextmanager
def _progress_bar(team: Team, *, shown: bool) -> Iterator[Callable[[Sequence[FrozenTrial]], None]]:
    """Give a function that shows how many trials are finished on standard error, if at all."""
    label = f"{team.job.config.objective} {team.job.config.metric}"
    with Progress(console=Console(stderr=True), disable=not shown) as progress:
        task = progress.add_task("trials", total=team.n_trials)

        def show(trials: Sequence[FrozenTrial]) -> None:
            finished = sum(trial.state.is_finished() for trial in trials)
            progress.update(task, completed=finished, description=summary(trials, label))

        yield show


def _write_files(study: optuna.Study, config: StudyConfig, folder: StudyFolder) -> None:
    """Write what a study found."""
    from sb3_piano.tuning.report import write_report, write_table  # not for each worker

    write_best(study, config, folder)
    write_table(study, config, folder)
    write_report(study, config, folder)
