"""Environments and models are built as the config says."""

import gymnasium as gym
import pytest
from stable_baselines3 import TD3
from stable_baselines3.common.noise import NormalActionNoise, OrnsteinUhlenbeckActionNoise
from stable_baselines3.common.vec_env import VecCheckNan, VecNormalize
from torch import nn
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.training.runs.builders import (
    algorithm_arguments,
    build_callbacks,
    build_model,
    build_vec_env,
)

tables = Tables(__file__)


@pytest.fixture
def build(small_config):
    """Build environments and close them afterwards."""
    built = []

    def make(**changes):
        built.append(build_vec_env(small_config(**changes)))
        return built[-1]

    yield make
    for venv in built:
        venv.close()


def test_wrappers_stand_in_the_order_of_the_config(build):
    venv = build(
        env_wrapper=[
            "gymnasium.wrappers.FlattenObservation",
            {"gymnasium.wrappers.TransformReward": {"func": None}},
        ],
        vec_env_wrapper="stable_baselines3.common.vec_env.VecCheckNan",
        normalize={"norm_reward": False},
        algorithm_kwargs={"gamma": 0.8},
    )
    assert isinstance(venv, VecNormalize)
    assert (venv.norm_reward, venv.gamma) == (False, 0.8)  # the discount is the algorithm's
    assert isinstance(venv.venv, VecCheckNan)
    env, names = venv.unwrapped.envs[0], []
    while isinstance(env, gym.Wrapper):
        names.append(type(env).__name__)
        env = env.env
    assert names[:3] == ["TransformReward", "FlattenObservation", "EpisodeLog"]


@tables("changes, message")
def test_an_environment_or_a_wrapper_that_refuses_its_arguments_is_named(build, changes, message):
    with pytest.raises(ConfigError, match=message):
        build(**changes)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("normal", NormalActionNoise), ("ornstein-uhlenbeck", OrnsteinUhlenbeckActionNoise)],
)
def test_the_model_gets_classes_schedules_tuples_and_noise(build, small_config, name, kind):
    changes = {
        "algorithm_kwargs": {
            "learning_rate": "lin_2e-3",
            "train_freq": [2, "step"],
            "policy_kwargs": {"net_arch": [4], "activation_fn": "nn.GELU"},
        },
        **{"noise_type": name, "noise_std": 0.2},
    }
    model = build_model(small_config(**changes), build(**changes))
    assert isinstance(model, TD3)
    assert isinstance(model.actor.mu[1], nn.GELU)
    assert (model.lr_schedule(1.0), model.lr_schedule(0.5)) == pytest.approx((0.002, 0.001))
    assert model.train_freq.frequency == 2
    assert model.seed == 1
    assert isinstance(model.action_noise, kind)
    assert model.action_noise._sigma.tolist() == [0.2]


def test_what_an_algorithm_or_a_callback_refuses_is_named(build, small_config):
    changes = {"env_id": "CartPole-v1"}
    with pytest.raises(ConfigError, match="TD3 cannot be made for 'CartPole-v1': .*action space"):
        build_model(small_config(**changes), build(**changes))
    changes |= {"noise_type": "normal", "noise_std": 0.1}
    with pytest.raises(ConfigError, match="'CartPole-v1' has the action space Discrete.*: expect"):
        build_model(small_config(**changes), build(**changes))
    changes = {"algorithm_kwargs": {"buffer_size": 1}}  # which could not be saved
    with pytest.raises(RunError, match="A ReplayBuffer of 1 row"):
        build_model(small_config(**changes), build(**changes))
    callback = "stable_baselines3.common.callbacks.CheckpointCallback"
    with pytest.raises(ConfigError, match="cannot be called with {}: miss"):
        build_callbacks(small_config(callback=callback))
    hidden = {"policy_kwargs": {"optimizer_kwargs": {"betas": ["os.system", 0.9]}}}
    message = r"optimizer_kwargs.betas\[0\]: 'os.system' is no subclass of Module or O"
    with pytest.raises(ConfigError, match=message):
        algorithm_arguments(small_config(algorithm_kwargs=hidden))
