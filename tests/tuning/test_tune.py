"""``sb3-piano tune`` from its options to its files, whoever is killed or interrupted meanwhile."""

from __future__ import annotations

import csv
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import optuna
import pytest
import yaml
from optuna.trial import TrialState
from small_study import (
    ENTRY,
    ENV_ID,
    Broken,
    HeldUntil,
    Killed,
    ThreadsNoted,
    small_study,
    wrapped,
)
from waiting import wait_for
from yaml_rows import Tables

from sb3_piano.cli import main
from sb3_piano.envs import GENERAL_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.locks import hold
from sb3_piano.training import RunFolder, load_config
from sb3_piano.tuning import StudyFolder, tune
from sb3_piano.tuning.storage import opened_store
from sb3_piano.tuning.study import counting

tables = Tables(__file__)

pytestmark = pytest.mark.slow

MIDI_FILE = Path(__file__).parents[1] / "data" / "five_fingers.mid"
PIECE = ("--env", ENV_ID)
LASTING = {"n_timesteps": 200, "learning_starts": 190}


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    """A folder to work in, with a small configuration and a small search space."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)  # wrappers
    write_settings()
    return tmp_path


def write_settings(**entry):
    space = {"gamma": {"discount": [0.6, 0.9]}, "tau": {"float": [0.001, 0.1]}}
    for name, content in {"small.yml": {"default": {**ENTRY, **entry}}, "space.yml": space}.items():
        Path(name).write_text(yaml.safe_dump(content))


def options(*more, piece=PIECE):
    given = ["tune", "--algo", "td3", *piece, "--config", "small.yml", "--space", "space.yml"]
    steps = yaml.safe_load(Path("small.yml").read_text())["default"]["n_timesteps"]
    given += ["--steps", str(steps), "--evaluations", "2", "--no-progress", "--name", "study"]
    return [*given, *more]


def trials_of(url=None, folder=StudyFolder(Path("studies/study"))):  # noqa: B008 - frozen
    """Return the trials of the study, all and those that count."""
    with opened_store(url, folder) as store:
        study = optuna.load_study(study_name="study", storage=store)
        return study.get_trials(), counting(study)


# A study that nobody disturbs.


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which the command has finished a study of two workers, and what it printed."""
    folder = tmp_path_factory.mktemp("finished")
    out = folder / "out.txt"
    with pytest.MonkeyPatch.context() as patch, out.open("w") as printed:
        patch.chdir(folder)
        patch.setattr(sys, "stdout", printed)
        for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            patch.delenv(name, raising=False)
        write_settings(**wrapped(ThreadsNoted, file=str(folder / "threads"), parent=os.getpid()))
        more = ("--trials", "3", "--seeds", "2", "--workers", "2", "--seed", "0")
        assert main(options(*more, piece=("--midi", str(MIDI_FILE)))) == 0
    return folder, out.read_text()


def test_two_workers_find_the_best_settings_and_tell_where_everything_is(finished, monkeypatch):
    folder, out = finished
    monkeypatch.chdir(folder)
    assert "studies/study, 3 trials, highest final f1 " in out
    assert "(of the preset: " in out
    for name in ("best.yml", "report.html", "trials.csv"):
        assert f"studies/study/{name}" in out
    assert "<html" in Path("studies/study/report.html").read_text()
    (shown,) = re.findall("^Train: *(.*)", out, re.MULTILINE)
    assert shown.startswith(f"sb3-piano train --algo td3 --env {GENERAL_ID} --config studies/study")
    assert shown in Path("studies/study/best.yml").read_text()
    best = load_config("td3", GENERAL_ID, Path("studies/study/best.yml"))
    assert (best.n_timesteps, best.env_kwargs["score"]) == (40, str(MIDI_FILE))
    with Path("studies/study/trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["steps"] for row in rows] == ["80"] * 3
    assert (
        float(max(rows, key=lambda row: float(row["value"]))["gamma"])
        == (best.algorithm_kwargs["gamma"])
    )
    # Two workers have run every trial once, the first with the preset's settings.
    folder = StudyFolder(Path("studies/study"))
    trials, _ = trials_of(folder=folder)
    assert [trial.state for trial in trials] == 3 * [TrialState.COMPLETE]
    assert trials[0].params == {"1 - gamma": 0.2, "tau": 0.005}
    assert len({trial.params["tau"] for trial in trials}) == 3
    assert len(list(folder.workers_dir.glob("*.log"))) == 2
    assert list(folder.workers_dir.glob("*.lock")) == []
    for trial in trials:
        run = RunFolder.open(folder.trial_dir(trial.number) / "seed_1")
        assert run.read_config().algorithm_kwargs["tau"] == trial.params["tau"]
    assert sorted(path.name for path in (folder.path / "trials").iterdir()) == list("012")
    assert Path("threads").read_text() == "1"  # as the workers share the cores
    backend = optuna.storages.journal.JournalFileBackend(str(folder.journal_file))
    store = optuna.storages.JournalStorage(backend)  # Optuna by itself
    assert optuna.load_study(study_name="study", storage=store).best_value > 0


def test_a_study_goes_on_with_more_trials_and_its_seed_decides_on_each(finished, capsys, files):
    shutil.copytree(finished[0] / "studies", "studies")
    shutil.copy(finished[0] / "small.yml", "small.yml")
    more = ("--seeds", "2", "--seed", "0")
    before, _ = trials_of()
    assert main(options(*more, "--trials", "4", piece=("--midi", str(MIDI_FILE)))) == 0
    after, _ = trials_of()
    assert after[:3] == before
    assert len(after) == 4
    assert main(options(*more, "--trials", "4", piece=("--midi", str(MIDI_FILE)))) == 0
    assert trials_of()[0] == after
    assert ", 4 trials, highest" in capsys.readouterr().out
    seeds = ("--seeds", "1")
    assert main(options(*seeds, "--trials", "4", piece=("--midi", str(MIDI_FILE)))) == 2
    assert "Study 'study' has seeds [0, 1], not [0]: expected" in capsys.readouterr().err


# Whoever dies.


def gone(pid):
    return not Path(f"/proc/{pid}").exists()


def pids_of_workers():
    return [log.stem.rpartition("-")[2] for log in Path("studies/study/workers").glob("*.log")]


def run(*more, killed_parent=False):
    """Run the command here; if it is to be killed, first in a process of its own."""
    if killed_parent:
        started = "import os, sys, pathlib; pathlib.Path('parent').write_text(str(os.getpid())); "
        started += f"from sb3_piano.cli import main; sys.exit(main({options(*more)!r}))"
        done = subprocess.run([sys.executable, "-c", started], capture_output=True, check=False)
        assert done.returncode == -signal.SIGKILL, done.stderr
        wait_for(lambda: all(map(gone, pids_of_workers())), seconds=10)
    return main(options(*more))


@pytest.mark.parametrize("who", ["worker", "parent", "worker on Ray"])
def test_settings_of_whom_was_killed_are_run_again_and_nothing_else(who, request, capsys):
    other = "parent" if who == "parent" else None
    write_settings(**wrapped(Killed, marker=os.path.abspath("killed"), other=other))
    more = ["--trials", "3", "--workers", "2" if who == "worker" else "1"]
    if who == "worker on Ray":
        more += ["--ray", request.getfixturevalue("ray_cluster").address]
    assert run(*more, killed_parent=who == "parent") == 0, capsys.readouterr().err
    assert Path("killed").exists()
    trials, count = trials_of()
    assert [trial.state for trial in count] == 3 * [TrialState.COMPLETE]
    assert len({str(trial.params) for trial in count}) == 3
    (lost,) = [trial for trial in trials if trial not in count]
    assert lost.state is TrialState.FAIL
    (again,) = [each for each in count if each.params == lost.params]
    assert again.number > lost.number
    with Path("studies/study/trials.csv").open() as file:
        assert list(csv.DictReader(file))[lost.number]["state"] == "repeated"


def test_workers_that_die_at_once_end_the_study_with_one_error(monkeypatch, capsys):
    monkeypatch.setattr(sys.modules[tune.__module__], "MAX_DEATHS", 2)
    write_settings(**wrapped(Killed))
    assert main(options("--trials", "2")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "2 workers in a row ended before a trial was finished, the last one so: " in line
    assert "SIGKILL" in line


def test_ctrl_c_ends_the_workers_and_the_same_command_goes_on(capsys):
    write_settings(**LASTING, **wrapped(HeldUntil, marker=os.path.abspath("quick")))
    given = options("--trials", "1")
    command = [sys.executable, "-m", "sb3_piano.cli", *given]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, start_new_session=True, **pipes) as process:
        wait_for(lambda: list(Path().glob("studies/*/trials/0/seed_0/monitor/*.csv")))
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (130, "")
    assert "Interrupted: the same command goes on." in out
    assert Path("studies/study/report.html").is_file()
    assert all(map(gone, pids_of_workers()))
    stopped, _ = trials_of()
    assert [trial.state for trial in stopped] == [TrialState.FAIL, TrialState.WAITING]
    Path("quick").touch()
    assert main(given) == 0
    assert ", 1 trials, highest final f1 " in capsys.readouterr().out
    assert [trial.params for trial in trials_of()[1]] == [stopped[0].params]


# What is refused.


def error(capsys, *more, piece=PIECE):
    """Run the command and return the one line that says what is wrong."""
    assert main(options(*more, piece=piece)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    return line


def test_a_study_without_a_complete_trial_is_an_error(capsys):
    write_settings(**wrapped(Broken, limit=30))
    assert main(options("--trials", "2")) == 2
    out = capsys.readouterr().out
    assert "No trial is complete." in out
    assert "Failed:     RuntimeError: a string has broken" in out
    assert not Path("studies/study/best.yml").exists()
    (log,) = Path("studies/study/workers").glob("*.log")
    assert "Traceback" in log.read_text()


def test_a_study_that_another_process_runs_is_refused(capsys):
    with hold(Path("studies/study/workers/study.lock")):
        found = error(capsys)
    assert re.search(r"is being run by process \d+ on .*: expected one command", found)


@tables("more, reason")
def test_a_wrong_option_is_told_in_one_line(more, reason, capsys):
    assert reason in error(capsys, *more)


@pytest.mark.parametrize("name", ["n_trials", "workers"])
def test_there_is_at_least_one_of_each(name):
    with pytest.raises(ConfigError, match=f"{name} is 0: expected a whole number, 1 or more"):
        tune(small_study(), "study", **{name: 0})


def test_an_impossible_range_is_refused_before_there_is_a_study(capsys):
    Path("space.yml").write_text("batch_size: {float: [1, 9.5]}")
    assert "{'batch_size': 9.5}: batch_size is 9.5: expected a whole number" in error(capsys)
    assert not Path("studies").exists()
