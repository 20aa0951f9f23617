"""The parent of workers: what it takes over from dead ones, here and on other machines."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable

import optuna
import pytest
import small_study
import sqlalchemy
from optuna.trial import TrialState

from sb3_piano.tuning import StudyFolder, storage
from sb3_piano.tuning.storage import open_storage, open_study
from sb3_piano.tuning.team import Heart, Team
from sb3_piano.tuning.trials import FOLDER, HOST, OWNER, repeated

pytestmark = [
    pytest.mark.slow,
    # Optuna means ask and tell without Heart.
    pytest.mark.filterwarnings("ignore:Heartbeat of storage:UserWarning"),
]

FORK = multiprocessing.get_context("fork")
CONFIG = small_study.small_study()


@pytest.fixture
def soon(monkeypatch):
    """Heartbeats that are quickly missed."""
    monkeypatch.setattr(storage, "HEARTBEAT_INTERVAL", 1)
    monkeypatch.setattr(storage, "GRACE_PERIOD", 4)


@pytest.fixture
def folder(tmp_path):
    return StudyFolder(tmp_path / "study")


def opened(folder, url, config=CONFIG):
    """Return a study with a connection of its own, and its heart."""
    store = open_storage(url, folder)
    study = open_study(config, store, name="small")
    return study, Heart(study, store)


def states(study):
    return [trial.state for trial in study.get_trials()]


def until(happened: Callable[[], object]) -> None:
    for _ in range(300):
        if happened():
            return
        time.sleep(0.1)
    raise AssertionError("it never happened")


def run(study, folder, heart, n_trials=1, on_progress=lambda trials: None, config=CONFIG):
    folder.workers_dir.mkdir(parents=True, exist_ok=True)
    team = Team(study, config, folder, heart=heart, n_trials=n_trials, n_workers=1)
    return team.run(on_progress)


def begin(study, host=None, folder=None) -> optuna.Trial:
    trial = study.ask()
    if host is not None:
        trial.set_user_attr(OWNER, [host, str(folder.path.resolve())])
    trial.set_user_attr(FOLDER, "/where/an/actor/runs/it")
    CONFIG.space.suggest(trial)
    return trial


def test_a_trial_that_a_dead_parent_left_is_run_again_at_once(database_url, folder):
    study, heart = opened(folder, database_url)
    params = begin(study, os.uname().nodename, folder).params
    assert not run(study, folder, heart)
    assert states(study) == [TrialState.FAIL, TrialState.COMPLETE]
    assert study.trials[1].params == params
    assert repeated(study.trials) == {0}


def work_elsewhere(url, folder, said) -> None:
    study, heart = opened(folder, url)
    trial = begin(study, "elsewhere", folder)
    heart.beat([trial])
    said.put(trial.number)
    time.sleep(60)


def test_the_trial_of_another_machine_is_run_again_when_its_heart_has_stopped(
    database_url, folder, soon
):
    study, heart = opened(folder, database_url)
    said = FORK.Queue()
    process = FORK.Process(target=work_elsewhere, args=(database_url, folder, said))
    process.start()
    said.get(timeout=60)
    heart.beat([])
    process.kill()
    process.join()
    assert states(study) == [TrialState.RUNNING]
    assert not run(study, folder, heart)
    assert states(study) == [TrialState.FAIL, TrialState.COMPLETE]
    assert study.trials[1].params == study.trials[0].params
    assert study.trials[1].user_attrs[HOST] == os.uname().nodename


def test_a_trial_whose_process_was_killed_before_it_began_does_not_run_for_ever(
    database_url, folder, soon
):
    study, heart = opened(folder, database_url)
    study.ask()
    heart.beat([])
    assert states(study) == [TrialState.RUNNING]  # it may be about to begin

    def is_queued() -> bool:
        heart.beat([])
        return states(study) == [TrialState.FAIL, TrialState.WAITING]

    until(is_queued)


def test_a_heart_that_beats_keeps_a_trial(database_url, folder, soon):
    study, heart = opened(folder, database_url)
    other, others_heart = opened(folder, database_url)
    trial = begin(study, "here", folder)
    for _ in range(14):  # twice as long as the grace period
        heart.beat([trial])
        others_heart.beat([])
        time.sleep(0.6)
    assert states(other) == [TrialState.RUNNING]


class Shut:
    """A database that lets nobody in for a while."""

    def __init__(self, url: str):
        self._name = sqlalchemy.make_url(url).database
        self._engine = sqlalchemy.create_engine(
            sqlalchemy.make_url(url).set(database="postgres"), isolation_level="AUTOCOMMIT"
        )

    def let_in(self, allowed: bool) -> None:
        with self._engine.connect() as connection:
            for statement in (
                f"ALTER DATABASE {self._name} ALLOW_CONNECTIONS {allowed}",
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                f"WHERE datname = '{self._name}'",
            ):
                connection.execute(sqlalchemy.text(statement))
        self._engine.dispose()


def test_a_study_goes_on_after_the_server_was_away(database_url, folder):
    study, heart = opened(folder, database_url)
    database, calls = Shut(database_url), []

    def close_once(trials) -> None:
        if any(trial.state is TrialState.RUNNING for trial in trials) and not calls:
            calls.append("closed")
            database.let_in(False)
            signal.signal(signal.SIGALRM, lambda number, frame: database.let_in(True))
            signal.alarm(3)

    assert not run(study, folder, heart, on_progress=close_once)
    assert calls
    assert states(study) == [TrialState.COMPLETE]


def test_the_result_of_a_trial_that_was_given_away_is_not_taken(database_url, folder, tmp_path):
    slow = small_study.wrapped(small_study.HeldUntil, marker=str(tmp_path / "quick"))
    config = small_study.small_study(entry=slow)
    study, heart = opened(folder, database_url, config)
    other, _ = opened(folder, database_url, config)

    def give_away(trials) -> None:
        if trials[0].state is TrialState.RUNNING and len(trials) == 1:
            other.tell(0, state=TrialState.FAIL)
            other.enqueue_trial({"gamma": 0.75})
            (tmp_path / "quick").touch()

    assert not run(study, folder, heart, 2, give_away, config)
    assert states(study) == [TrialState.FAIL, TrialState.COMPLETE]
    assert study.trials[1].params == {"gamma": 0.75}
