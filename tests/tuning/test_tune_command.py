"""``sb3-piano tune``: the command, its output and its errors."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import optuna
import pytest
import yaml
from small_study import ENTRY, ENV_ID, HeldUntil, wrapped

from sb3_piano.cli import main
from sb3_piano.envs import GENERAL_ID
from sb3_piano.training import load_config
from sb3_piano.tuning import StudyFolder
from sb3_piano.tuning.storage import open_storage

pytestmark = pytest.mark.slow

MIDI_FILE = Path(__file__).parents[1] / "data" / "five_fingers.mid"


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A folder to work in, with a small configuration and a small search space."""
    monkeypatch.chdir(tmp_path)
    write_settings()
    return tmp_path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder in which the command has finished a study, and what it printed."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as out:
        patch.chdir(folder)
        write_settings()
        command = arguments(
            "--trials", "2", "--seed", "0", "--midi", str(MIDI_FILE), "--seeds", "2"
        )
        assert main(without_env(command)) == 0
    return folder, out.getvalue()


def write_settings():
    write("small.yml", {"default": ENTRY})
    write("space.yml", {"gamma": {"discount": [0.6, 0.9]}, "tau": {"float": [0.001, 0.1]}})


def write(name, content):
    Path(name).write_text(yaml.safe_dump(content))


def arguments(*more):
    command = ["tune", "--algo", "td3", "--env", ENV_ID, "--config", "small.yml"]
    command += ["--space", "space.yml", "--steps", "40", "--evaluations", "2", "--no-progress"]
    return [*command, *more]


def without_env(command):
    place = command.index("--env")
    return [*command[:place], *command[place + 2 :]]


def error(capsys, *more):
    """Run the command and return the one line that says what is wrong."""
    assert main(arguments(*more)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    return line


def shown_command(out):
    """Return the command that is printed to train with the best settings."""
    (line,) = [line for line in out.splitlines() if line.startswith("Train:")]
    return line.partition(":")[2].strip()


def test_a_study_tells_what_it_found_and_where_everything_is(finished, monkeypatch):
    files, out = finished
    monkeypatch.chdir(files)
    folder = "studies/td3-five_fingers"
    assert f"{folder}, 2 trials, highest final f1 " in out
    assert "(of the preset: " in out
    for name in ("best.yml", "report.html", "trials.csv"):
        assert f"{folder}/{name}" in out
        assert (files / folder / name).is_file()
    assert f"sb3-piano train --algo td3 --env {GENERAL_ID} --config {folder}/best.yml" in out
    assert shown_command(out) in (files / folder / "best.yml").read_text()
    best = load_config("td3", GENERAL_ID, files / folder / "best.yml")
    assert (best.n_timesteps, best.env_kwargs["score"]) == (40, str(MIDI_FILE))
    with (files / folder / "trials.csv").open() as file:
        assert [row["steps"] for row in csv.DictReader(file)] == ["80", "80"]


def test_a_study_without_a_complete_trial_is_an_error(files, capsys):
    Path("small.yml").write_text(yaml.safe_dump({"default": {**ENTRY, "learning_rate": 1e30}}))
    assert main(arguments("--trials", "1")) == 2
    assert "No trial is complete." in (out := capsys.readouterr().out)
    assert "Failed:     InvalidActionError" in out


@pytest.fixture
def slow_study(files, monkeypatch):
    """Start a study whose trial does not end before there is a file ``quick``.

    The value is the command and its process, which is the leader of a group of its own.
    """
    slow = wrapped(HeldUntil, marker=str(files / "quick"))
    write("small.yml", {"default": {**ENTRY, "learning_starts": 190, **slow}})
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)  # of `slow`
    command = [sys.executable, "-m", "sb3_piano.cli", *arguments("--trials", "1")]
    command[command.index("--steps") + 1] = "200"
    process = subprocess.Popen(
        command, start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    while not list(files.glob("studies/*/trials/*/seed_0/monitor/*.csv")):
        assert process.poll() is None
        time.sleep(0.05)
    yield command, process
    (files / "quick").touch()  # for a worker that has not ended, as it should have
    process.kill()
    process.communicate()


def test_ctrl_c_on_the_terminal_stops_it(slow_study):
    _, process = slow_study
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does it
    out, err = process.communicate()
    assert process.returncode == 130, err
    assert "Interrupted: the same command goes on." in out


def workers_of(folder):
    """Return the workers that live, by the process ids in the names of their logs."""
    ids = [log.stem.rpartition("-")[2] for log in folder.workers_dir.glob("*.log")]
    return [pid for pid in ids if Path(f"/proc/{pid}").exists()]


def test_the_worker_of_a_killed_study_ends_and_the_same_command_goes_on(files, slow_study, capsys):
    command, process = slow_study
    folder = StudyFolder(next(files.glob("studies/*")))
    assert folder.path.name == f"td3-{ENV_ID}"
    assert len(workers_of(folder)) == 1
    process.kill()
    process.wait()
    deadline = time.monotonic() + 120
    while workers_of(folder):
        assert time.monotonic() < deadline, "the worker goes on"
        time.sleep(0.1)
    (files / "quick").touch()
    assert main(command[3:]) == 0
    assert ", 1 trials, highest final f1 " in capsys.readouterr().out
    study = optuna.load_study(study_name=folder.path.name, storage=open_storage(None, folder))
    states = [trial.state.name for trial in study.trials]
    assert states == ["FAIL", "COMPLETE"]
    assert study.trials[0].params == study.trials[1].params


def test_an_impossible_range_is_refused_before_there_is_a_study(files, capsys):
    write("space.yml", {"gamma": {"float": [0.5, 1.5]}})
    assert "'gamma' = 1.5: gamma is 1.5: expected a finite number from 0 to 1" in error(capsys)
    assert not (files / "studies").exists()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--metric", "f2"], "metric is 'f2': expected one of 'f1', 'onset_f1'"),
        (["--sampler", "tpee"], "sampler is 'tpee'"),
        (["--pruner", "medium"], "pruner is 'medium'"),
        (["--space", "sacc"], "Did you mean 'sac'"),
        (["--eval-seed", "0"], "eval_seed is 0"),
        (["--midi", str(MIDI_FILE)], "--midi cannot be given with --env"),
        (["--storage", "sqlite:///x.db"], "SQLite"),
        (["--storage", "nowhere"], "is no URL of a database"),
        (["--name", "../elsewhere"], "--name is '../elsewhere': expected the name of a folder in"),
        (["--name", ".."], "--name is '..': expected the name of a folder in --studies-dir"),
        (["--name", ""], "--name is '': expected the name of a folder in --studies-dir"),
    ],
)
def test_a_wrong_option_is_told_in_one_line(options, reason, files, capsys):
    assert reason in error(capsys, *options)
