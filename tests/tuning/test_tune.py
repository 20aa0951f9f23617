"""Studies with worker processes: nothing is lost and nothing is done twice.

The workers are the same with both stores, which only the parent knows: each test has one of them.
"""

from __future__ import annotations

import csv
import os
import shutil
import signal
import threading
import time

import optuna
import pytest
import small_study
import yaml
from optuna.trial import TrialState

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.locks import hold
from sb3_piano.training import RunFolder, load_config
from sb3_piano.tuning import Float, Search, Space, team, tune
from sb3_piano.tuning.trials import repeated

pytestmark = pytest.mark.slow

small = small_study.small_study
TWO = Space({"gamma": Float(0.7, 0.9), "learning_rate": Float(1e-4, 1e-2, log=True)})


def run(config, folder, storage=None, **options):
    arguments = {"n_trials": 4, "workers": 2, "progress_bar": False, **options}
    arguments.setdefault("name", f"{folder.name}-{time.time_ns()}")
    return tune(config, folder / "study", storage=storage, **arguments)


def states(result):
    return [trial.state for trial in result.study.trials]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study in its folder, which one worker has finished."""
    config = small(TWO, {"learning_rate": 2e-3})
    folder = tmp_path_factory.mktemp("finished")
    return tune(config, folder / "small", n_trials=3, search=Search(seed=0), progress_bar=False)


def test_the_first_trial_has_the_presets_settings(finished):
    assert finished.study.trials[0].params == {"gamma": 0.8, "learning_rate": 2e-3}
    assert finished.preset.number == 0


def test_what_comes_out_is_ready_for_use(finished):
    assert finished.best.value == max(trial.value for trial in finished.trials)
    config = load_config("td3", small_study.ENV_ID, finished.folder.best_file)
    assert config.algorithm_kwargs["gamma"] == finished.best.params["gamma"]
    with finished.folder.table_file.open() as file:
        assert len(list(csv.DictReader(file))) == 3
    assert yaml.safe_load(finished.folder.best_file.read_text()).keys() == {small_study.ENV_ID}
    assert "<html" in finished.folder.report_file.read_text()


def test_optuna_itself_can_read_the_store(finished):
    backend = optuna.storages.journal.JournalFileBackend(str(finished.folder.journal_file))
    storage = optuna.storages.JournalStorage(backend)
    study = optuna.load_study(study_name="small", storage=storage)
    assert study.best_value == finished.best.value


def test_two_workers_run_every_trial_once(tmp_path, monkeypatch):
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    noted = small_study.wrapped(small_study.ThreadsNoted, file=str(tmp_path / "threads"))
    result = run(small(TWO, noted), tmp_path, search=Search(seed=0))
    assert states(result) == 4 * [TrialState.COMPLETE]
    assert not result.interrupted
    assert len(list(result.folder.workers_dir.glob("*.log"))) == 2
    assert list(result.folder.workers_dir.glob("*.lock")) == []
    assert len({trial.params["gamma"] for trial in result.trials}) == 4
    for trial in result.trials:
        run_folder = RunFolder.open(tmp_path / f"study/trials/{trial.number}/seed_0")
        assert run_folder.read_config().algorithm_kwargs["gamma"] == trial.params["gamma"]
    assert sorted(path.name for path in (tmp_path / "study/trials").iterdir()) == list("0123")
    assert (tmp_path / "threads").read_text() == "1"  # as the workers share the cores


def test_a_killed_worker_is_noticed_and_its_trial_run_again(postgresql_url, tmp_path):
    killed = small_study.wrapped(small_study.KilledOnce, marker=str(tmp_path / "killed"))
    result = run(small(TWO, killed), tmp_path, postgresql_url, n_trials=2, workers=1)
    assert (tmp_path / "killed").exists()
    assert [trial.state for trial in result.trials] == 2 * [TrialState.COMPLETE]
    (lost,) = repeated(result.study.trials)
    dead = result.study.trials[lost]
    assert dead.state is TrialState.FAIL
    (again,) = [trial for trial in result.trials if trial.params == dead.params]
    assert again.number != dead.number
    with result.folder.table_file.open() as file:
        row = list(csv.DictReader(file))[lost]
    assert (row["state"], "killed" in row["failure"]) == ("repeated", True)


def test_a_study_goes_on_where_it_was_also_with_more_trials(finished, tmp_path):
    shutil.copytree(finished.folder.path, tmp_path / "study")
    config = small(TWO, {"learning_rate": 2e-3})
    more = run(config, tmp_path, n_trials=4, workers=1, name="small")
    assert states(more) == 4 * [TrialState.COMPLETE]
    assert more.trials[:3] == finished.trials
    again = run(config, tmp_path, n_trials=4, name="small")
    assert again.trials == more.trials


def test_ctrl_c_stops_the_workers_and_the_same_call_goes_on(tmp_path, ctrl_c):
    name = f"stopped-{time.time_ns()}"
    slow = small_study.wrapped(small_study.HeldUntil, marker=str(tmp_path / "quick"))
    config = small(TWO, {"n_timesteps": 200, "learning_starts": 190, **slow})
    stopper = threading.Thread(target=press_ctrl_c_once_begun, args=(tmp_path / "study",))
    stopper.start()
    stopped = run(config, tmp_path, n_trials=2, name=name)
    stopper.join()
    assert stopped.interrupted
    assert TrialState.RUNNING not in states(stopped)
    assert TrialState.WAITING in states(stopped)
    assert (tmp_path / "study/report.html").is_file()
    (tmp_path / "quick").touch()
    result = run(config, tmp_path, n_trials=2, workers=1, name=name)
    assert [trial.state for trial in result.trials] == 2 * [TrialState.COMPLETE]
    stopped_settings = {trial.params["gamma"] for trial in stopped.study.trials if trial.params}
    assert stopped_settings <= {trial.params["gamma"] for trial in result.trials}


def press_ctrl_c_once_begun(folder):
    while not list(folder.glob("trials/*/seed_0/monitor/*.csv")):
        time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)


def test_a_study_in_which_every_trial_fails_says_why(tmp_path):
    entry = small_study.wrapped(small_study.Broken, limit=30)
    result = run(small(TWO, entry), tmp_path, n_trials=2, workers=1)
    assert result.best is None
    assert result.failures == {"RuntimeError: a string has broken"}
    assert not result.folder.best_file.exists()
    (log,) = result.folder.workers_dir.glob("*.log")
    assert "Traceback" in log.read_text()


def test_a_study_that_another_process_runs_is_refused(tmp_path):
    with (
        hold(tmp_path / "study/workers/study.lock"),
        pytest.raises(RunError, match=r"is being run by process \d+ on .*: expected one command"),
    ):
        run(small(TWO), tmp_path)


def test_runs_of_another_study_are_not_overwritten(tmp_path):
    (tmp_path / "study/trials/0").mkdir(parents=True)
    with pytest.raises(RunError, match="has runs of trials, but its study has none"):
        run(small(TWO), tmp_path)


def test_workers_that_die_at_once_end_the_study_with_one_error(tmp_path, monkeypatch):
    monkeypatch.setattr(team, "_MAX_DEATHS", 2)
    config = small(TWO, small_study.wrapped(small_study.KilledAlways))
    with pytest.raises(RunError, match="2 workers in a row ended with signal SIGKILL"):
        run(config, tmp_path, workers=1)


@pytest.mark.parametrize("name", ["n_trials", "workers"])
def test_there_is_at_least_one_of_each(name, tmp_path):
    with pytest.raises(ConfigError, match=f"{name} is 0: expected a whole number, 1 or more"):
        run(small(TWO), tmp_path, **{name: 0})
