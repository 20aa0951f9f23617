"""One study on many machines, in a real PostgreSQL server: who dies there, and what is away."""

from __future__ import annotations

import multiprocessing
import threading
import time
from pathlib import Path

import optuna
import pytest
import small_study
import sqlalchemy
from optuna.trial import TrialState

from sb3_piano.exceptions import RunError
from sb3_piano.tuning import Search, StudyFolder, storage, tune
from sb3_piano.tuning.storage import open_study, opened_store
from sb3_piano.tuning.study import OWNER

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
        trial.set_user_attr(OWNER, "elsewhere")
        config.space.suggest(trial)
        time.sleep(1)
        said.put(trial.number)
        time.sleep(60)
        return 0.0

    with opened_store(url, StudyFolder(folder)) as store:
        open_study(config, store, name="small", search=Search()).optimize(objective, n_trials=1)


def test_trials_of_processes_that_are_gone_are_run_again(database_url, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "GRACE_PERIOD", 4)
    config, folder = small_study.small_study(), tmp_path / "study"
    said = FORK.Queue()
    process = FORK.Process(target=work_elsewhere, args=(config, folder, database_url, said))
    process.start()
    said.get(timeout=60)
    process.kill()
    process.join()
    with opened_store(database_url, StudyFolder(folder)) as store:
        study = open_study(config, store, name="small", search=Search())
        study.ask()  # by a process that was killed before it gave a heartbeat
    states, trials = run(config, folder, database_url, n_trials=2)
    # Nobody waits for the second one, of which nobody knows who ran it.
    assert states == [TrialState.FAIL, TrialState.RUNNING, TrialState.COMPLETE]
    assert trials[0].params == trials[2].params


def let_in(url: str, allowed: bool) -> None:
    """Let a database take connections, or end those that it has and refuse others."""
    name = sqlalchemy.make_url(url).database
    engine = sqlalchemy.create_engine(
        sqlalchemy.make_url(url).set(database="postgres"), isolation_level="AUTOCOMMIT"
    )
    with engine.connect() as connection:
        for statement in (
            f"ALTER DATABASE {name} ALLOW_CONNECTIONS {allowed}",
            f"SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'",
        ):
            connection.execute(sqlalchemy.text(statement))
    engine.dispose()


def run_meanwhile(tmp_path, url, happens, n_trials=1):
    """Run a study whose first trial waits until something has happened."""
    quick = tmp_path / "quick"

    def watch() -> None:
        while not list(Path(tmp_path).glob("study/trials/0/seed_0/monitor/*.csv")):
            time.sleep(0.05)
        happens(quick)

    thread = threading.Thread(target=watch)
    thread.start()
    entry = small_study.wrapped(small_study.HeldUntil, marker=str(quick))
    found = run(small_study.small_study(entry=entry), tmp_path / "study", url, n_trials)
    thread.join()
    return found


def test_a_study_goes_on_after_the_server_was_away_and_its_trial_as_well(database_url, tmp_path):
    def shut(quick: Path) -> None:
        let_in(database_url, False)
        quick.touch()
        time.sleep(4)
        let_in(database_url, True)

    states, _ = run_meanwhile(tmp_path, database_url, shut)
    assert states == [TrialState.COMPLETE]


def test_a_server_that_stays_away_is_given_up(database_url, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "PATIENCE", 0.1)

    def lose() -> None:
        with opened_store(database_url, StudyFolder(tmp_path)) as store:
            let_in(database_url, False)
            optuna.get_all_study_names(store)

    with pytest.raises(RunError, match="any more: .*: when it is back, the same command goes on"):
        lose()


def test_the_result_of_a_trial_that_was_given_away_is_not_taken(database_url, tmp_path):
    def give_away(quick: Path) -> None:
        with opened_store(database_url, StudyFolder(tmp_path)) as store:
            study = optuna.load_study(study_name="small", storage=store)
            study.tell(0, state=TrialState.FAIL)
            study.enqueue_trial({"gamma": 0.75}, user_attrs={OWNER: "elsewhere"})
        quick.touch()

    states, trials = run_meanwhile(tmp_path, database_url, give_away, n_trials=2)
    assert states == [TrialState.FAIL, TrialState.COMPLETE]
    assert (trials[0].value, trials[1].params) == (None, {"gamma": 0.75})
