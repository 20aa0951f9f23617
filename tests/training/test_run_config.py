"""A run's config is checked when it is made and survives YAML."""

import contextlib
import sys
from pathlib import Path

import pytest
import yaml
from stable_baselines3.common.buffers import ReplayBuffer

from sb3_piano.exceptions import ConfigError
from sb3_piano.music import load_score
from sb3_piano.training import Plugin, RunConfig
from sb3_piano.training.configuration.names import ALGORITHMS, algorithm_class
from sb3_piano.training.runs.builders import build_vec_env

WRAPPER = "gymnasium.wrappers.RescaleAction"


@pytest.fixture
def full_config(small_config):
    """A config that uses every field."""
    return small_config(
        algo="sac",
        n_envs=2,
        vec_env="subproc",
        env_wrapper=[{WRAPPER: {"min_action": -1.0, "max_action": 1}}],
        vec_env_wrapper="stable_baselines3.common.vec_env.VecCheckNan",
        callback=["sb3_piano.callbacks.EpisodeMetricsCallback"],
        normalize="dict(norm_obs=True, clip_obs=5)",
        monitor_kwargs="dict(info_keywords=('f1', 'recall'))",
        noise_type="ornstein-uhlenbeck",
        noise_std="1e-1",
        env_kwargs={"max_episode_steps": 20, "score": Path("piece.mid"), "pair": (1, 2)},
        algorithm_kwargs={
            "learning_rate": "lin_3e-4",
            "train_freq": [4, "step"],
            "ent_coef": "auto_0.1",
            "policy_kwargs": "dict(net_arch=[8], activation_fn=nn.GELU)",
            "replay_buffer_class": ReplayBuffer,
            "replay_buffer_kwargs": {"handle_timeout_termination": True},
        },
    )


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


def test_a_config_does_not_share_what_it_was_given(small_config):
    arch = [8]
    config = small_config(algorithm_kwargs={"policy_kwargs": {"net_arch": arch}})
    arch.append(9)
    assert config.algorithm_kwargs["policy_kwargs"]["net_arch"] == [8]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"algo": "tdd3"}, "Unknown algorithm 'tdd3'. Did you mean 'td3'"),
        ({"env_id": "Pendulm-v1"}, "Unknown environment 'Pendulm-v1'. Did you mean 'Pendulum-v1'"),
        ({"env_id": "nowhere:Pendulum-v1"}, "Module 'nowhere' of environment 'Pendulum-v1' cannot"),
        ({"n_timesteps": 0}, "n_timesteps is 0: expected a whole number from 1"),
        ({"n_timesteps": "many"}, "n_timesteps is 'many': expected a whole number"),
        ({"seed": -1}, "seed is -1: expected a whole number, 0 or more"),
        ({"seed": True}, "seed is True: expected a whole number"),
        ({"vec_env": "subprocess"}, "vec_env is 'subprocess': .* Did you mean 'subproc'"),
        ({"policy": "MlpPolcy"}, "Unknown policy 'MlpPolcy' of TD3. Did you mean 'MlpPolicy'"),
        ({"policy": "torch.nn.ReLU"}, "policy: 'torch.nn.ReLU' is no subclass of BasePolicy"),
        ({"noise_type": "norml", "noise_std": 0.1}, "noise_type is 'norml': .*'normal'"),
        ({"noise_type": "normal"}, "noise_type is 'normal' and noise_std None: expected both"),
        ({"noise_std": 0.1}, "noise_type is None and noise_std 0.1: expected both or neither"),
        ({"noise_type": "normal", "noise_std": -1}, "noise_std is -1: expected a finite"),
        ({"env_wrapper": "no.such.Wrapper"}, "env_wrapper: 'no.such.Wrapper' cannot be imported"),
        ({"env_wrapper": "gymnasium.wrappers.RescaleActoin"}, "Did you mean 'RescaleAction'"),
        (
            {"env_wrapper": "torch.nn.ReLU"},
            "env_wrapper: 'torch.nn.ReLU' is no subclass of Wrapper",
        ),
        ({"vec_env_wrapper": WRAPPER}, f"vec_env_wrapper: '{WRAPPER}' is no subclass of VecEnvW"),
        ({"callback": {"os.system": {"command": "false"}}}, "callback: 'os.system' is no subclass"),
        ({"policy": [1, [2]]}, r"policy is \[1, \[2\]\]: expected text"),
        ({"env_id": 3}, "env_id is 3: expected text"),
        ({"env_module": "tabnanny"}, "Module 'tabnanny' does not register environment"),
        pytest.param({"n_timesteps": 10**400}, "n_timesteps is 10.*0: expected a whole", id="huge"),
        ({"vec_env_wrapper": 3}, "vec_env_wrapper: 3 is no entry for vec_env_wrapper: expected"),
        ({"callback": {"a.b": {}, "c.d": {}}}, "callback: .* is no entry for callback"),
        ({"callback": "NoDots"}, "callback: 'NoDots' is no import path"),
        ({"normalize": "dict(norm_observation=True)"}, "'norm_observation' of VecNormalize"),
        ({"normalize": 1}, "normalize is 1: expected a mapping"),
        ({"monitor_kwargs": {"filename": "x"}}, "Unknown key 'filename' of Monitor"),
        (
            {"env_kwargs": {"score": load_score("CMajorScaleOneHand")}},
            "env_kwargs.score is a Score, wh",
        ),
        (
            {"n_envs": 2, "algorithm_kwargs": {"train_freq": [1, "episode"]}},
            r"train_freq is \[1, 'episode'\] with 2 agents in 2 environment",
        ),
        ({"env_kwargs": {1: 2}}, "env_kwargs is .*: expected a mapping from names"),
        ({"env_kwargs": {"a": [{1: 2}]}}, r"env_kwargs.a\[0\] has the key 1: expected text"),
    ],
    ids=str,
)
def test_a_wrong_setting_is_refused_by_name(small_config, changes, message):
    with pytest.raises(ConfigError, match=message):
        small_config(**changes)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("gama", 0.9, "Unknown key 'gama' of TD3. Did you mean 'gamma'.* Expected one of learn"),
        ("n_timestep", 10, "'n_timestep' of TD3. Did you mean 'n_timesteps'"),
        ("env", "x", "Unknown key 'env' of TD3"),
        ("use_sde", True, "Unknown key 'use_sde' of TD3"),
        ("_init_setup_model", False, "Unknown key '_init_setup_model' of TD3"),
        ("gamma", "high", "gamma is 'high': expected a finite number"),
        ("batch_size", 2.5, "batch_size is 2.5: expected a whole number"),
        ("gamma", 1.5, "gamma is 1.5: expected a finite number from 0 to 1"),
        ("learning_rate", "lin_0", "learning_rate is 0.0: expected a finite number above 0"),
        ("train_freq", 0, "train_freq is 0: expected a whole number, 1 or more"),
        ("optimize_memory_usage", 1, "optimize_memory_usage is 1: expected true or false"),
        ("policy_kwargs", {"net_arh": [8]}, "'net_arh' of TD3Policy. Did you mean 'net_arch'"),
        ("device", "abc", "device is 'abc': expected auto, cpu, cuda or another of torch's"),
        ("policy_kwargs", {"activation_fn": "os.system"}, "'os.system' is no subclass of Module"),
        ("replay_buffer_class", "nn.ReLU", "'nn.ReLU' is no subclass of ReplayBuffer"),
        ("policy_kwargs", "dict(a=exit())", "cannot be read .*: expected literals"),
    ],
    ids=str,
)
def test_a_wrong_argument_of_the_algorithm_is_refused_by_name(small_config, name, value, message):
    with pytest.raises(ConfigError, match=message):
        small_config(algorithm_kwargs={name: value})


def test_noise_is_refused_where_the_algorithm_has_none(small_config):
    with pytest.raises(ConfigError, match="noise_type is 'normal', but PPO takes no action noise"):
        RunConfig(
            algo="ppo", env_id="Pendulum-v1", n_timesteps=5, noise_type="normal", noise_std=0.1
        )


def test_unknown_and_missing_keys_of_a_mapping_are_named(small_config):
    mapping = small_config().to_mapping()
    with pytest.raises(ConfigError, match=r"Unknown setting 'n_env' of RunConfig. Did you"):
        RunConfig(**{**mapping, "n_env": 1})
    del mapping["n_timesteps"]
    with pytest.raises(ConfigError, match="n_timesteps is missing"):
        RunConfig(**mapping)


def test_a_correction_of_no_run_names_none(small_config):
    config = small_config(env_wrapper="sb3_piano.training.RunResidual")
    assert config.env.base is None


def test_the_module_of_an_environment_is_imported_and_remembered(
    small_config, tmp_path, monkeypatch
):
    (tmp_path / "registering_module.py").write_text(
        "import gymnasium\n"
        "gymnasium.register('Elsewhere-v0', 'gymnasium.envs.classic_control:PendulumEnv')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    config = small_config(env_id="registering_module:Elsewhere-v0")
    assert (config.env_module, config.env_id) == ("registering_module", "Elsewhere-v0")
    assert RunConfig(**config.to_mapping()) == config
    assert "registering_module" in sys.modules


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


@pytest.mark.parametrize("name", ALGORITHMS)
def test_every_algorithm_can_be_imported_and_configured(name):
    assert algorithm_class(name).__name__.lower() == name
    RunConfig(algo=name, env_id="Pendulum-v1", n_timesteps=1, algorithm_kwargs={"gamma": "0.8"})
