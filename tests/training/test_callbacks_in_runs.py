"""Callbacks in ``sb3-piano train``, where environment and folder are the run's, and in RL Zoo."""

import json
from pathlib import Path

import gymnasium as gym
import pytest
from acting import VEC_ENVS, scalars
from fresh_python import run_python
from stable_baselines3 import TD3
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_piano.cli import main
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.training import resume
from sb3_piano.training.runs.builders import build_vec_env
from sb3_piano.training.runs.saved import load_statistics


class WithMetrics(gym.Wrapper):
    """Give the final ``info`` music metrics; named in configs by its import path."""

    def step(self, action):
        *result, info = self.env.step(action)
        if result[2] or result[3]:
            info.update(f1=0.5, return_energy=-3.0)
        return (*result, info)


ENV_ID = "RoboPianist-v0"
F1 = "sb3_piano.callbacks.F1Callback"
WITH_METRICS = f"{__name__}.WithMetrics"


@pytest.fixture
def run_with(run):
    """Train on a Pendulum that tells music metrics."""

    def start(**changes):
        return run(**{"env_wrapper": WITH_METRICS, **changes})

    return start


@pytest.mark.slow
@pytest.mark.parametrize("vec_env", VEC_ENVS)
def test_evaluation_in_a_run_has_the_runs_wrappers_and_normalisation(
    run_with, vec_env, small_config, episodes_of
):
    n_envs = 1 if vec_env == "subproc" else 2  # processes take long to start
    folder = run_with(
        vec_env=vec_env,
        n_envs=n_envs,
        normalize=True,
        monitor_kwargs={"allow_early_resets": False},  # which an evaluation may do nevertheless
        callback={F1: {"eval_freq": 50 // n_envs}},
    ).folder
    assert scalars(folder, "eval/f1") == {50: 0.5, 100: 0.5}
    assert set(scalars(folder, "eval/mean_reward")) == {50, 100}
    note = json.loads((folder.path / "best_f1" / "best_model.json").read_text())
    assert note == {"metric": "f1", "value": 0.5, "num_timesteps": 50}
    assert TD3.load(folder.path / "best_f1" / "best_model.zip").num_timesteps == 50
    config = small_config(normalize=True)
    venv = build_vec_env(config)
    load_statistics(config, folder.path / "best_f1" / "vecnormalize.pkl", venv)
    assert venv.obs_rms.count > 50
    # one file for each training environment, without the episodes of the evaluations
    assert len(list(folder.monitor_dir.iterdir())) == n_envs
    n_episodes = n_envs * (100 // n_envs // 20)
    assert [episode["l"] for episode in episodes_of(folder.monitor_dir)] == [20] * n_episodes


@pytest.mark.slow
def test_a_resumed_run_keeps_its_best_model(run_with):
    folder = run_with(callback={F1: {"eval_freq": 50}}).folder
    # What the training plays is logged without being asked for.
    assert set(scalars(folder, "music/f1")) == {50, 80, 100}
    assert set(scalars(folder, "reward/energy").values()) == {-3.0}
    note = folder.path / "best_f1" / "best_model.json"
    first = json.loads(note.read_text())
    resume(folder.path, 200, progress_bar=False)
    assert json.loads(note.read_text()) == first  # the same again is no better
    note.write_text(json.dumps({**first, "value": 0.1}))
    resume(folder.path, 300, progress_bar=False)
    assert json.loads(note.read_text()) == {"metric": "f1", "value": 0.5, "num_timesteps": 250}


LOGGED = {
    f"{group}/{name}" for group in ("music", "eval") for name in ("f1", "onset_f1", "noop_f1")
}
LOGGED |= {"fingers/r1", "reward/key_press", "reward/energy", "eval/mean_reward"}
"""Some of what the log of a training with every callback has."""


def write_yaml(path, score, out):
    """Write a tiny TD3 of 200 steps with everything on; models and videos go into ``out``."""
    text = (Path(__file__).parents[1] / "data" / "every_callback.yml").read_text()
    path.write_text(text.replace("SCORE", str(score)).replace("OUT", str(out)))


def check_what_was_written(out, log):
    """Compare the files of the callbacks, and the log's folder, with what was asked for."""
    best = {path.name for path in (out / "best").iterdir()}
    assert best == {"best_model.zip", "best_model.json", "vecnormalize.pkl"}
    kinds = {path.suffix for path in (out / "videos").glob("step_150.*")}
    assert kinds - {".mid"} == {".wav", ".mp4"} - ({".mp4"} if find_gl_backend() is None else set())
    [path] = log.glob("events.*")
    events = EventAccumulator(str(path)).Reload()
    assert set(events.Tags()["scalars"]) >= LOGGED
    assert {event.step for event in events.Scalars("eval/onset_f1")} == {100, 200}


@pytest.mark.slow
def test_every_callback_from_one_yaml_file_in_sb3_piano_train(midi_file, tmp_path):
    write_yaml(tmp_path / "all.yml", midi_file, tmp_path)
    command = ["train", "--config", str(tmp_path / "all.yml"), "--env", ENV_ID, "--seed", "1"]
    assert main([*command, "--no-progress", "--out", str(tmp_path / "run")]) == 0
    check_what_was_written(tmp_path, tmp_path / "run" / "tensorboard" / "run_1")
    assert (tmp_path / "run" / "best_onset_f1" / "best_model.zip").is_file()


@pytest.mark.slow
def test_every_callback_from_one_yaml_file_in_the_stock_zoo(midi_file, tmp_path):
    pytest.importorskip("rl_zoo3")
    write_yaml(tmp_path / "all.yml", midi_file, tmp_path)
    command = ["-m", "rl_zoo3.train", "--algo", "td3", "--env", ENV_ID]
    command += ["--gym-packages", "sb3_piano", "--conf-file", str(tmp_path / "all.yml")]
    command += ["--seed", "1", "--log-folder", str(tmp_path / "logs"), "--eval-freq", "-1"]
    command += ["--tensorboard-log", str(tmp_path / "tb"), "--log-interval", "1"]
    done = run_python(command, tmp_path)
    assert done.returncode == 0, done.stderr
    check_what_was_written(tmp_path, tmp_path / "tb" / ENV_ID / "TD3_1")
    # the evaluations, of 25 steps each, left no line in the training's file
    run = tmp_path / "logs" / "td3" / f"{ENV_ID}_1"
    assert len((run / "0.monitor.csv").read_text().splitlines()) == 2 + 200 // 25
