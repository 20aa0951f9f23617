"""A run's config is checked when it is made and survives YAML."""

import contextlib
from pathlib import Path

import pytest
import yaml
from stable_baselines3.common.buffers import ReplayBuffer
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score
from sb3_piano.training import Plugin, RunConfig
from sb3_piano.training.runs.builders import build_vec_env

tables = Tables(__file__)

WRAPPER = "gymnasium.wrappers.RescaleAction"


@pytest.fixture
def full_config(small_config):
    """A config that uses every field."""
    settings = dict(tables["full"])
    arguments = {**settings.pop("algorithm_kwargs"), "replay_buffer_class": ReplayBuffer}
    played = {"max_episode_steps": 20, "score": Path("piece.mid"), "pair": (1, 2)}
    return small_config(algorithm_kwargs=arguments, env_kwargs=played, **settings)


def test_a_config_read_back_from_yaml_is_equal(full_config, small_config):
    for config in (full_config, small_config()):
        text = yaml.safe_dump(config.to_mapping())
        assert RunConfig(**yaml.safe_load(text)) == config


def test_values_are_converted_and_written_in_full(full_config):
    assert full_config.algorithm_kwargs["train_freq"] == (4, "step")
    assert full_config.algorithm_kwargs["policy_kwargs"]["activation_fn"] == "torch.nn.GELU"
    buffer_class = full_config.algorithm_kwargs["replay_buffer_class"]
    assert buffer_class == "stable_baselines3.common.buffers.ReplayBuffer"
    assert full_config.noise_std == 0.1
    assert full_config.normalize == {"norm_obs": True, "clip_obs": 5.0}
    assert full_config.monitor_kwargs == {"info_keywords": ("f1", "recall")}
    assert full_config.env_kwargs == {
        "max_episode_steps": 20, "score": "piece.mid", "pair": [1, 2]
    }  # fmt: skip
    wrapper = Plugin(path=WRAPPER, kwargs={"min_action": -1.0, "max_action": 1})
    assert full_config.env_wrapper == (wrapper,)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        *tables["a_wrong_setting_is_refused_by_name"],
        pytest.param({"n_timesteps": 10**400}, "n_timesteps is 10.*0: expected a whole", id="huge"),
        ({"env_kwargs": {"score": load_score("hanon-01")}}, "env_kwargs.score is a Score, wh"),
    ],
    ids=str,
)
def test_a_wrong_setting_is_refused_by_name(small_config, changes, message):
    with pytest.raises(ConfigError, match=message):
        small_config(**changes)


def test_unknown_missing_and_unfitting_keys_of_a_mapping_are_named(small_config):
    mapping = small_config().to_mapping()
    with pytest.raises(ConfigError, match=r"Unknown setting 'n_env' of RunConfig. Did you"):
        RunConfig(**{**mapping, "n_env": 1})
    noise = {"noise_type": "normal", "noise_std": 0.1}
    with pytest.raises(ConfigError, match="noise_type is 'normal', but PPO takes no action noise"):
        RunConfig(algo="ppo", env_id="Pendulum-v1", n_timesteps=5, **noise)
    del mapping["n_timesteps"]
    with pytest.raises(ConfigError, match="n_timesteps is missing"):
        RunConfig(**mapping)


def test_a_config_does_not_share_what_it_was_given_and_a_correction_of_no_run_names_none(
    small_config,
):
    arch = [8]
    arguments = {"policy_kwargs": {"net_arch": arch}}
    config = small_config(algorithm_kwargs=arguments, env_wrapper="sb3_piano.training.RunResidual")
    arch.append(9)
    assert config.algorithm_kwargs["policy_kwargs"]["net_arch"] == [8]
    assert config.env.base is None


@pytest.mark.parametrize(
    ("hands_in_scene", "agents", "count"), [("both", 1, 4), ("right", 1, 2), ("both", 0, 2)]
)
def test_the_agents_are_those_of_the_environments(small_config, hands_in_scene, agents, count):
    config = small_config(
        env_id="RoboPianist-scale-CMajor-v0",
        env_kwargs={"observation": "hands", "hands_in_scene": hands_in_scene},
        env_wrapper=["sb3_piano.wrappers.HandActions", "sb3_piano.wrappers.HandReward"],
        vec_env_wrapper=["sb3_piano.vec_env.HandsAsAgents"] * agents,
        n_envs=2,
    )
    with contextlib.closing(build_vec_env(config)) as venv:
        assert venv.num_envs == config.n_agents == count
