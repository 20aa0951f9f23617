"""The commands of docs/zoo.md do what it says, with a training of a few steps."""

import argparse
import importlib.util
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from fresh_python import run_python
from yaml_rows import Tables

from sb3_piano.hyperparams import PRESETS
from sb3_piano.simulation.gl import find_gl_backend

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("rl_zoo3") is None, reason="needs rl_zoo3"),
]

ENV_ID = "RoboPianist-debug-CMajorScaleOneHand-v0"  # of 151 steps
GUIDE = (Path(__file__).parents[2] / "docs" / "zoo.md").read_text(encoding="utf-8")
_PARTS = re.split(r"^## (.*)\n", GUIDE, flags=re.MULTILINE)[1:]
SECTIONS = dict(zip(_PARTS[::2], _PARTS[1::2], strict=True))

STEPS = 160
SHORT = Tables(__file__)["short"]


def blocks(section, language="bash"):
    return re.findall(rf"^```{language}\n(.*?)^```", SECTIONS[section], re.MULTILINE | re.DOTALL)


def briefly(command):
    """Return a training with one evaluation at its end."""
    return command.replace(
        "-m rl_zoo3.train", f"-m rl_zoo3.train --eval-freq {STEPS} --eval-episodes 1"
    )


def needs(*modules):
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    return pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(missing)} (docs/zoo.md)")


@pytest.fixture(scope="module")
def shell(tmp_path_factory):
    """Return a function that runs a command of the guide in one folder, and what it printed."""
    folder = tmp_path_factory.mktemp("zoo")

    def run(text):
        for old, new in SHORT.items():
            text = text.replace(old, new)
        program, *arguments = shlex.split(text.replace("\\\n", " "))
        assert program == "python"
        done = run_python(arguments, folder)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    entry = yaml.safe_load(PRESETS["sac"].read_text())[ENV_ID]
    entry |= {"n_timesteps": STEPS, "learning_starts": STEPS - 10, "buffer_size": 1000}
    (folder / "short.yml").write_text(yaml.safe_dump({ENV_ID: entry}))
    run.folder = folder
    return run


@pytest.fixture(scope="module")
def trained(shell):
    """The folder in which the guide's first command has trained."""
    (command,) = blocks("Train")
    printed = shell(briefly(command))
    assert "eval_env_kwargs={'observation': 'fingers'}" in printed
    return shell.folder / "logs" / "sac" / f"{ENV_ID}_1"


def test_what_the_tests_shorten_is_in_the_guide():
    assert [old for old in SHORT if old not in GUIDE] == []


def test_training_writes_the_files_that_the_guide_lists(trained):
    files = {path.name for path in trained.rglob("*") if path.is_file()}
    table = dict(re.findall(r"^\| (`.*?) \| (.*?) \|$", SECTIONS["Train"], re.MULTILINE))
    named = {Path(name).name for names in table for name in re.findall(r"`(.*?)`", names)}
    assert files == {name.replace("<id>", ENV_ID) for name in named} - {"vecnormalize.pkl"}
    _, names, *episodes = (trained / "0.monitor.csv").read_text().splitlines()
    assert {"f1", "onset_f1", "precision", "recall"} <= set(names.split(","))
    assert len(episodes) == STEPS // 151


def test_the_zoo_evaluates_without_the_env_kwargs_of_the_file(shell, trained):
    from rl_zoo3.exp_manager import ExperimentManager

    manager = ExperimentManager(
        argparse.Namespace(), "sac", ENV_ID, str(shell.folder / "other"),
        eval_freq=-1, verbose=0, config=str(shell.folder / "short.yml"),
    )  # fmt: skip
    model, _ = manager.setup_experiment()
    seen = manager.create_envs(1, eval_env=True).observation_space
    assert (model.observation_space.shape, seen.shape) == ((130,), (1124,))


def test_enjoy_plays_the_model_with_the_env_kwargs_of_its_training(shell, trained):
    (command,) = blocks("Enjoy")
    printed = shell(command.replace("-m rl_zoo3.enjoy", "-m rl_zoo3.enjoy -n 151"))
    found = re.search(r"Mean reward: ([\d.]+)", printed)
    best = np.load(trained / "evaluations.npz")["results"].max()
    # the best model's return was on the reference physics, this one is on the fast one
    assert float(found[1]) == pytest.approx(best, rel=0.05)


def test_a_model_of_the_zoo_is_judged_as_music(shell, trained, monkeypatch, capsys):
    (code,) = blocks("Enjoy", "py")
    monkeypatch.chdir(shell.folder)
    exec(compile(code, "docs/zoo.md", "exec"), {})
    printed = capsys.readouterr().out
    assert re.fullmatch(r"F1 0\.\d{3}, onset F1 0\.\d{3}, playing nothing 0\.007\n", printed)


@needs("moviepy")
@pytest.mark.skipif(find_gl_backend() is None, reason="needs EGL or OSMesa to draw")
def test_a_video_is_recorded(shell, trained):
    (command,) = blocks("Video")
    shell(command)
    assert len(list((shell.folder / "videos").glob("*.mp4"))) == 1


@needs("seaborn", "pandas")
def test_the_episodes_of_the_training_are_plotted(shell, trained):
    assert "No data available" not in shell(blocks("Plot")[0])


@needs("pandas")
def test_monitor_files_have_the_f1_of_each_episode(shell, trained, monkeypatch, capsys):
    (code,) = blocks("Plot", "py")
    monkeypatch.chdir(shell.folder)
    exec(compile(code, "docs/zoo.md", "exec"), {})
    names, episode = capsys.readouterr().out.splitlines()
    assert names.split() == ["l", "r", "f1", "onset_f1"]
    assert episode.split()[:2] == ["0", "151"]


@needs("pandas")
def test_the_zoo_optimises_the_return_at_a_high_gamma(shell):
    import optuna
    from optuna.storages.journal import JournalFileBackend

    (command,) = blocks("Optimise")
    assert "Best trial" in shell(briefly(command))
    (table,) = (shell.folder / "logs" / "sac").glob("report_*.csv")
    assert len(table.read_text().splitlines()) == 1 + 2
    log = JournalFileBackend(str(shell.folder / "logs" / "scale.log"))
    study = optuna.load_study(study_name="scale", storage=optuna.storages.JournalStorage(log))
    assert all(0.97 <= trial.user_attrs["gamma"] <= 0.9999 for trial in study.trials)
    assert study.best_value > 50  # a return; no F1 is above 1
