"""Optuna studies: real trials, a few steps long."""

from __future__ import annotations

import optuna
import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from sb3_piano.exceptions import ConfigError
from sb3_piano.training import RunConfig, RunFolder
from sb3_piano.tuning import Objective

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
    with pytest.raises(ConfigError, match="metric is 'f2': expected one of f1, length"):
        study.optimize(Objective(CONFIG, {}, tmp_path, metric="f2"), n_trials=1)


def test_an_unknown_setting_is_refused_before_anything_is_trained(tmp_path):
    objective = Objective(CONFIG, {"gama": FloatDistribution(0, 1)}, tmp_path)
    with pytest.raises(ConfigError, match="Unknown key 'gama' for TD3. Did you mean 'gamma'"):
        optuna.create_study().optimize(objective, n_trials=1)
    assert not any(tmp_path.iterdir())


def test_a_space_of_another_kind_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="The space of 'gamma' is 0.8: expected a distribution"):
        Objective(CONFIG, {"gamma": 0.8}, tmp_path)
