"""One study on many machines, in a real PostgreSQL server: who dies there, and what is away."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
from pathlib import Path

import optuna
import pytest
import small_study
import sqlalchemy
from optuna.trial import TrialState

from sb3_piano.tuning import StudyFolder, storage, team, tune
from sb3_piano.tuning.storage import open_study, opened_store
from sb3_piano.tuning.trials import HOST, OWNER

pytestmark = [
    pytest.mark.slow,
    # Optuna means ask without optimize.
    pytest.mark.filterwarnings("ignore:Heartbeat of storage:UserWarning"),
]

FORK = multiprocessing.get_context("fork")


def run(config, folder, url, n_trials=1):
    """Run a study to its end and return the states of its trials, and them."""
    tune(config, folder, name="small", n_trials=n_trials, storage=url, progress_bar=False)
    with opened_store(url, StudyFolder(folder)) as store:
        trials = optuna.load_study(study_name="small", storage=store).get_trials()
    return [trial.state for trial in trials], trials


def work_elsewhere(config, folder, url, said) -> None:
    """Begin a trial as another machine does, and tell when it has had its first heartbeat."""

    def objective(trial: optuna.Trial) -> float:
        trial.set_user_attr(OWNER, ["elsewhere", str(folder), "job"])
        config.space.suggest(trial)
        time.sleep(1)
        said.put(trial.number)
        time.sleep(60)
        return 0.0

    with opened_store(url, StudyFolder(folder)) as store:
        open_study(config, store, name="small").optimize(objective, n_trials=1)


def test_trials_of_a_machine_that_is_gone_are_run_again(database_url, tmp_path, monkeypatch):
    for module in (storage, team):
        monkeypatch.setattr(module, "GRACE_PERIOD", 4)
    config, folder = small_study.small_study(), tmp_path / "study"
    said = FORK.Queue()
    process = FORK.Process(target=work_elsewhere, args=(config, folder, database_url, said))
    process.start()
    said.get(timeout=60)
    process.kill()
    process.join()
    with opened_store(database_url, StudyFolder(folder)) as store:
        study = open_study(config, store, name="small")
        study.ask()  # by a process that was killed before it gave a heartbeat
    states, trials = run(config, folder, database_url, n_trials=2)
    assert states == 2 * [TrialState.FAIL] + 2 * [TrialState.COMPLETE]
    assert trials[0].params in [trial.params for trial in trials[2:]]
    assert {trial.user_attrs[HOST] for trial in trials[2:]} == {os.uname().nodename}


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


def meanwhile(tmp_path, happens) -> tuple[dict, threading.Thread]:
    """Return an entry whose first trial waits until something has happened, and who does that."""
    quick = tmp_path / "quick"

    def watch() -> None:
        while not list(Path(tmp_path).glob("study/trials/0/seed_0/monitor/*.csv")):
            time.sleep(0.05)
        happens(quick)

    thread = threading.Thread(target=watch)
    thread.start()
    return small_study.wrapped(small_study.HeldUntil, marker=str(quick)), thread


def test_a_study_goes_on_after_the_server_was_away_and_its_trial_as_well(database_url, tmp_path):
    def shut(quick: Path) -> None:
        Shut(database_url).let_in(False)
        quick.touch()
        time.sleep(4)
        Shut(database_url).let_in(True)

    entry, thread = meanwhile(tmp_path, shut)
    states, _ = run(small_study.small_study(entry=entry), tmp_path / "study", database_url)
    thread.join()
    assert states == [TrialState.COMPLETE]


def test_the_result_of_a_trial_that_was_given_away_is_not_taken(database_url, tmp_path):
    def give_away(quick: Path) -> None:
        with opened_store(database_url, StudyFolder(tmp_path)) as store:
            study = optuna.load_study(study_name="small", storage=store)
            study.tell(0, state=TrialState.FAIL)
            study.enqueue_trial({"gamma": 0.75}, user_attrs={OWNER: ["elsewhere", "", ""]})
        quick.touch()

    entry, thread = meanwhile(tmp_path, give_away)
    config = small_study.small_study(entry=entry)
    states, trials = run(config, tmp_path / "study", database_url, n_trials=2)
    thread.join()
    assert states[0] is TrialState.FAIL
    assert states.count(TrialState.COMPLETE) == 2
    assert trials[1].params == {"gamma": 0.75}
    assert trials[0].value is None
