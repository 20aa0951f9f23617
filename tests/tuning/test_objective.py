"""Optuna studies: real trials, a few steps long."""

from __future__ import annotations

import dataclasses
import os
import signal

import gymnasium as gym
import optuna
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import RunConfig, RunFolder
from sb3_piano.tuning import Objective


class StoppedInSecondEpisode(gym.Wrapper):
    """Press Ctrl-C in the second episode played after a rest; named by its import path."""

    resets = 0

    def reset(self, **arguments):
        self.resets += 1  # for the rest and after it, for the first episode and after it
        return self.env.reset(**arguments)

    def step(self, action):
        if self.resets == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return self.env.step(action)


CONFIG = RunConfig(
    algo="td3",
    env_id="RoboPianist-debug-TwinkleTwinkleLittleStar-v0",
    n_timesteps=30,
    seed=0,
    env_kwargs={"n_steps_lookahead": 1},
    algorithm_kwargs={
        "learning_starts": 20,
        "buffer_size": 100,
        "batch_size": 8,
        "policy_kwargs": {"net_arch": [8]},
    },
)


def test_a_study_trains_each_trial_in_its_own_run_with_the_suggested_settings(tmp_path):
    space = {
        "gamma": FloatDistribution(0.7, 0.9),
        "batch_size": CategoricalDistribution([4, 8]),
        "env_kwargs.n_steps_lookahead": IntDistribution(0, 2),
    }
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.RandomSampler(seed=0))
    study.optimize(Objective(CONFIG, space, tmp_path), n_trials=2)
    for trial in study.trials:
        config = RunFolder.open(tmp_path / f"trial_{trial.number}").read_config()
        assert config.algorithm_kwargs["gamma"] == trial.params["gamma"]
        assert config.algorithm_kwargs["batch_size"] == trial.params["batch_size"]
        lookahead = trial.params["env_kwargs.n_steps_lookahead"]
        assert config.env_kwargs == {"n_steps_lookahead": lookahead}
        assert 0 <= trial.value <= 1


def test_an_unknown_metric_is_answered_with_those_there_are(tmp_path):
    study = optuna.create_study()
    with pytest.raises(
        ConfigError, match=r"metric is 'f2'\. Did you mean .*'f1'.* Expected one of"
    ):
        study.optimize(Objective(CONFIG, {}, tmp_path, metric="f2"), n_trials=1)


def test_an_unknown_setting_is_refused_before_anything_is_trained(tmp_path):
    objective = Objective(CONFIG, {"gama": FloatDistribution(0, 1)}, tmp_path)
    with pytest.raises(ConfigError, match="Unknown key 'gama' for TD3. Did you mean 'gamma'"):
        optuna.create_study().optimize(objective, n_trials=1)
    assert not any(tmp_path.iterdir())


def test_a_space_of_another_kind_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="The space of 'gamma' is 0.8: expected a distribution"):
        Objective(CONFIG, {"gamma": 0.8}, tmp_path)


def test_ctrl_c_within_an_evaluation_ends_the_study(tmp_path, ctrl_c):
    """A mean over fewer episodes than the others' would be no value of the trial."""
    wrapper = f"{__name__}.{StoppedInSecondEpisode.__name__}"
    config = dataclasses.replace(CONFIG, env_wrapper=wrapper)
    study = optuna.create_study()
    with pytest.raises(KeyboardInterrupt):
        study.optimize(Objective(config, {}, tmp_path, episodes=2), n_trials=1)
    assert study.trials[0].value is None
    assert (tmp_path / "trial_0" / "evaluation" / "metrics.json").is_file()
