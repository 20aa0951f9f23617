"""Music metrics and reward terms arrive in SB3's log, at the right line, with the right value."""

from __future__ import annotations

import csv

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3 import PPO, TD3
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.logger import configure

from sb3_piano.callbacks import EpisodeMetricsCallback


class ScriptedEnv(gym.Env):
    """Episodes of five steps; the F1 of the n-th is n / 10, from 0.1 on."""

    observation_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)
    action_space = gym.spaces.Box(-1.0, 1.0, (1,), dtype=np.float32)

    def __init__(self, **extra):
        self.extra = extra
        self.episode = 0

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.episode += 1
        self.step_number = 0
        return np.zeros(2, dtype=np.float32), {}

    def step(self, action):
        self.step_number += 1
        over = self.step_number == 5
        info = {"f1": self.episode / 10, "return_energy": -self.episode, **self.extra}
        return np.zeros(2, dtype=np.float32), 0.0, False, over, info if over else {"f1": 99.0}


def logged(folder, make_model, steps, callback=None, log_interval=1):
    """Train and return the log's lines, by step."""
    model = make_model()
    model.set_logger(configure(str(folder), ["csv"]))
    model.learn(steps, callback=callback or EpisodeMetricsCallback(), log_interval=log_interval)
    with (folder / "progress.csv").open() as file:
        return {int(line["time/total_timesteps"]): line for line in csv.DictReader(file)}


def off_policy(n_envs=1, **extra):
    venv = make_vec_env(lambda: ScriptedEnv(**extra), n_envs=n_envs)
    kwargs = {"policy_kwargs": {"net_arch": [4]}, "buffer_size": 100, "device": "cpu"}
    return lambda: TD3("MlpPolicy", venv, learning_starts=1000, **kwargs)


def on_policy(n_steps):
    return lambda: PPO(
        "MlpPolicy", ScriptedEnv(), n_steps=n_steps, batch_size=n_steps, n_epochs=1, device="cpu"
    )


def test_an_off_policy_log_has_the_episode_that_ended_in_its_step(tmp_path):
    lines = logged(tmp_path, off_policy(), 20)
    assert {step: float(line["music/f1"]) for step, line in lines.items()} == pytest.approx(
        {5: 0.1, 10: 0.2, 15: 0.3, 20: 0.4}
    )
    assert float(lines[10]["reward/energy"]) == -2.0


def test_a_line_has_the_mean_of_the_episodes_since_the_last_line(tmp_path):
    lines = logged(tmp_path, off_policy(), 40, log_interval=4)
    assert {step: float(line["music/f1"]) for step, line in lines.items()} == pytest.approx(
        {20: 0.25, 40: 0.65}
    )


def test_three_environments_are_averaged(tmp_path):
    # 3 episodes end at a time; SB3 writes a line after each of them, the first with all values
    lines = logged(tmp_path, off_policy(n_envs=3), 30, log_interval=3)
    assert {step: float(line["music/f1"]) for step, line in lines.items()} == pytest.approx(
        {15: 0.1, 30: 0.2}
    )


def test_an_on_policy_log_has_the_episodes_of_its_rollout(tmp_path):
    lines = logged(tmp_path, on_policy(10), 20)
    assert {step: float(line["music/f1"]) for step, line in lines.items()} == pytest.approx(
        {10: 0.15, 20: 0.35}
    )


def test_only_the_keys_that_were_named_are_logged(tmp_path):
    lines = logged(tmp_path, off_policy(), 10, EpisodeMetricsCallback(["f1", "absent"]))
    names = set(lines[10])
    assert "music/f1" in names
    assert not names & {"reward/energy", "music/absent"}


def test_what_is_no_number_is_not_logged_by_default(tmp_path):
    lines = logged(tmp_path, off_policy(return_notes={"c": 1}), 10)
    assert "reward/notes" not in lines[10]


def test_other_environments_log_nothing(tmp_path):
    def make_model():
        env = gym.make("Pendulum-v1", max_episode_steps=10)
        return TD3("MlpPolicy", env, learning_starts=100, buffer_size=100, device="cpu")

    lines = logged(tmp_path, make_model, 20)
    assert not [name for name in lines[20] if name.startswith(("music/", "reward/"))]
