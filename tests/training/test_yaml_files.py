"""Hyperparameter files in RL Zoo's form, and the presets that come with the package."""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.cli import main
from sb3_piano.envs import DEBUG_IDS, GENERAL_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import PRESETS
from sb3_piano.training import load_config
from sb3_piano.training.runs.builders import build_callbacks, build_model, build_vec_env

ZOO_FILE = """
defaults: &base
  n_timesteps: !!float 1e4
  policy: 'MlpPolicy'
  buffer_size: 1.0e3
  learning_rate: 7.3e-4
  policy_kwargs: "dict(net_arch=[64, 64], activation_fn=nn.ReLU)"

Pendulum-v1:
  <<: *base
  n_envs: 2
  env_kwargs: {max_episode_steps: 20, render_mode: null}
  env_wrapper:
    - gymnasium.wrappers.RescaleAction:
        min_action: -1.0
        max_action: 1.0
    - gymnasium.wrappers.FlattenObservation
  noise_type: 'normal'
  noise_std: 0.1

MountainCarContinuous-v0:
  <<: *base
"""


@pytest.fixture
def zoo_file(tmp_path):
    path = tmp_path / "td3.yml"
    path.write_text(ZOO_FILE)
    return path


def test_an_entry_of_the_zoo_is_split_into_run_and_algorithm(zoo_file):
    config = load_config("td3", "Pendulum-v1", zoo_file)
    assert (config.n_timesteps, config.n_envs, config.noise_std) == (10_000, 2, 0.1)
    assert [plugin.path.rpartition(".")[2] for plugin in config.env_wrapper] == [
        "RescaleAction",
        "FlattenObservation",
    ]
    assert config.algorithm_kwargs == {
        "buffer_size": 1000,
        "learning_rate": 0.00073,
        "policy_kwargs": {"net_arch": [64, 64], "activation_fn": "torch.nn.ReLU"},
    }


def test_default_stands_for_all_other_environments(tmp_path):
    path = tmp_path / "a.yml"
    path.write_text("default: {n_timesteps: 5}\nPendulum-v1: {n_timesteps: 7}\n")
    assert load_config("sac", "Pendulum-v1", path).n_timesteps == 7
    assert load_config("sac", "gymnasium:Pendulum-v1", path).n_timesteps == 7
    assert load_config("sac", "MountainCarContinuous-v0", path).n_timesteps == 5


def test_overrides_replace_keys_and_env_kwargs_are_added(zoo_file):
    config = load_config(
        "td3",
        "Pendulum-v1",
        zoo_file,
        n_timesteps=50,
        gamma="0.5",
        seed=0,
        env_kwargs={"max_episode_steps": 9, "g": 5.0},
    )
    assert (config.n_timesteps, config.seed) == (50, 0)
    assert config.algorithm_kwargs["gamma"] == 0.5
    assert config.env_kwargs == {"max_episode_steps": 9, "render_mode": None, "g": 5.0}


def test_an_unknown_environment_is_answered_before_the_file_is_read(zoo_file):
    with pytest.raises(ConfigError, match=r"^Unknown environment 'Pendulum-v9'"):
        load_config("td3", "Pendulum-v9", zoo_file)


def test_an_environment_without_entry_is_answered_with_the_nearest_one(zoo_file):
    with pytest.raises(ConfigError, match=r"td3\.yml' has no entry for 'MountainCar-v0'. Did you"):
        load_config("td3", "MountainCar-v0", zoo_file)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a: [", r"a\.yml' is not valid YAML: while parsing"),
        ("- 1\n", r"a\.yml' holds list at the top level: expected a mapping"),
        ("", r"a\.yml' holds NoneType at the top level"),
        ("x: !!python/object/apply:os.getcwd []", "is not valid YAML: could not determine"),
        ("default:", r"a\.yml', entry 'default': It holds None: expected a mapping of hyper"),
        ("default: {gamma: 0.9}", "entry 'default': n_timesteps is missing"),
        ("Pendulum-v1: {n_timesteps: 5, gama: 1}", "entry 'Pendulum-v1': Unknown key 'gama' for"),
        ("default: {n_timesteps: 5, tau: low}", "a.yml', entry 'default': tau is 'low': expected"),
        ("default: {n_timesteps: 5, 3: 4}", "entry 'default': algorithm_kwargs is .* from names"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_the_reason(tmp_path, content, message):
    path = tmp_path / "a.yml"
    path.write_text(content)
    with pytest.raises(ConfigError, match=message):
        load_config("td3", "Pendulum-v1", path)


def test_numbers_that_python_refuses_are_told(tmp_path, capsys):
    path = tmp_path / "long.yml"
    path.write_text(f"default:\n  n_timesteps: {'1' * 5000}\n")
    with pytest.raises(ConfigError, match="long.yml' is not valid YAML: Exceeds the limit"):
        load_config("td3", "Pendulum-v1", path)
    assert main(["record", "CMajorScaleOneHand", "--set", f"width={'1' * 5000}"]) == 2
    assert "its value is not valid YAML: Exceeds the limit" in capsys.readouterr().err


def test_a_missing_or_binary_file_is_named(tmp_path):
    with pytest.raises(ConfigError, match=r"none\.yml' cannot be read: No such file"):
        load_config("td3", "Pendulum-v1", tmp_path / "none.yml")
    (tmp_path / "binary.yml").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(ConfigError, match=r"binary\.yml' cannot be read: it is not UTF-8"):
        load_config("td3", "Pendulum-v1", tmp_path / "binary.yml")


def test_a_wrong_override_is_named_as_such(zoo_file):
    with pytest.raises(ConfigError, match="'Pendulum-v1' with n_envs replaced: n_envs is 0"):
        load_config("td3", "Pendulum-v1", zoo_file, n_envs=0)


def test_an_algorithm_without_preset_asks_for_a_file():
    with pytest.raises(ConfigError, match="for 'a2c': expected one of crossq, ddpg, .* or a YAML"):
        load_config("a2c", "RoboPianist-v0")


@pytest.mark.parametrize("algo", ["ddpg", "sac", "td3", "tqc"])
def test_a_preset_loads_for_our_environments_with_the_published_values(algo):
    config = load_config(algo, "RoboPianist-v0")
    arguments = config.algorithm_kwargs
    assert arguments["policy_kwargs"]["net_arch"] == [256, 256, 256]
    assert (arguments["gamma"], arguments["tau"]) == (0.8, 0.005)
    assert (arguments["learning_rate"], arguments["batch_size"]) == (0.0003, 256)
    assert (arguments["buffer_size"], arguments["learning_starts"]) == (1_000_000, 5000)
    assert (arguments["train_freq"], arguments["gradient_steps"]) == (1, 1)
    assert config.n_timesteps == 1_000_000
    assert config.monitor_kwargs == {"info_keywords": ("precision", "recall", "f1", "onset_f1")}
    (callback,) = config.callback
    assert (callback.path, callback.kwargs) == (
        "sb3_piano.callbacks.F1Callback",
        {"eval_freq": 10000},
    )


IDS = (GENERAL_ID, *DEBUG_IDS)
"""The ids that the files name, and one of those that go by the default."""

MUSIC = ("precision", "recall", "f1", "onset_f1")
OFF_POLICY = ("crossq", "ddpg", "sac", "td3", "tqc")
STEPS = 24

# What makes a training of a few steps, without another key than the file has.
BRIEF = {algo: {"learning_starts": 16, "buffer_size": 64, "batch_size": 8} for algo in OFF_POLICY}
BRIEF["ppo"] = {"n_envs": 2, "n_steps": 8, "batch_size": 8, "n_epochs": 1}


def settings(config):
    """Return a config's settings without what differs from id to id."""
    mapping = config.to_mapping()
    return {name: value for name, value in mapping.items() if name not in ("env_id", "env_module")}


def distinct_ids(algo):
    """Return the first id of each entry that differs from those before it."""
    found = []
    for env_id in IDS:
        here = settings(load_config(algo, env_id))
        if all(settings(load_config(algo, other)) != here for other in found):
            found.append(env_id)
    return found


ENTRIES = [(algo, env_id) for algo in PRESETS for env_id in distinct_ids(algo)]


@pytest.mark.parametrize("algo", PRESETS)
def test_a_file_has_a_default_and_an_entry_for_each_debug_piece(algo):
    assert list(yaml.safe_load(PRESETS[algo].read_text())) == ["default", *DEBUG_IDS]


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("algo", PRESETS)
def test_every_file_has_valid_settings_for_every_id(algo, env_id):
    config = load_config(algo, env_id)
    assert (config.algo, config.env_id) == (algo, env_id)
    assert config.policy == "MlpPolicy"
    assert config.monitor_kwargs == {"info_keywords": MUSIC}
    assert [plugin.path for plugin in config.callback] == ["sb3_piano.callbacks.F1Callback"]
    (callback,) = build_callbacks(config)
    assert callback.eval_freq * config.n_envs < config.n_timesteps  # it does evaluate
    short = {"observation": "fingers", "physics": "fast"}
    assert config.env_kwargs == ({} if env_id == GENERAL_ID else short)


@pytest.mark.parametrize("algo", PRESETS)
def test_a_file_says_where_each_default_value_comes_from(algo):
    *_, rest = PRESETS[algo].read_text().partition("\ndefault:\n")
    lines = rest.partition("\n\n")[0].splitlines()
    keys = [line.split(":")[0].strip() for line in lines if not line.strip().startswith("#")]
    assert len(keys) > 10
    for before, line in zip(["", *lines], lines, strict=False):
        above = before.strip().startswith("#")
        plain = line.strip() in ("policy: MlpPolicy", "policy_kwargs:")
        assert "#" in line or above or plain, line


@pytest.mark.parametrize("algo", OFF_POLICY)
def test_a_replay_buffer_is_compact_and_holds_the_whole_training(algo):
    for env_id in IDS:
        config = load_config(algo, env_id)
        arguments = config.algorithm_kwargs
        assert arguments["replay_buffer_class"] == "sb3_piano.buffers.CompactReplayBuffer"
        assert arguments["buffer_size"] >= config.n_timesteps
        assert arguments["gamma"] == 0.8


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["crossq", "sac", "tqc"])
def test_the_entropy_is_set_for_the_number_of_actions(algo):
    for env_id in IDS:
        n_actions = gym.make(env_id).action_space.shape[0]
        entropy = load_config(algo, env_id).algorithm_kwargs["target_entropy"]
        if env_id == GENERAL_ID:
            assert entropy == -0.5 * n_actions
        else:
            assert -2 * n_actions <= entropy < -n_actions


@pytest.mark.slow
@pytest.mark.parametrize(("algo", "env_id"), ENTRIES)
def test_an_entry_trains(algo, env_id):
    config = load_config(algo, env_id, seed=1, **BRIEF[algo])
    venv = build_vec_env(config)
    model = build_model(config, venv)
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(STEPS)
    venv.close()
    after = model.policy.state_dict()
    assert all(torch.isfinite(value).all() for value in after.values())
    assert any(not torch.equal(value, before[name]) for name, value in after.items())
    learned = {k: v for k, v in model.logger.name_to_value.items() if k.startswith("train/")}
    assert any("loss" in name for name in learned)
    assert all(np.isfinite(value) for value in learned.values()), learned
    if isinstance(model, OffPolicyAlgorithm):
        assert type(model.replay_buffer) is CompactReplayBuffer
        assert model.replay_buffer.size() == STEPS
    else:
        assert algo == "ppo"


@pytest.mark.slow
@pytest.mark.parametrize(("algo", "env_id"), ENTRIES)
def test_the_stock_zoo_makes_the_same_model_of_an_entry(algo, env_id, tmp_path):
    manager = pytest.importorskip("rl_zoo3.exp_manager").ExperimentManager(
        argparse.Namespace(), algo, env_id, str(tmp_path),
        eval_freq=-1, seed=3, verbose=0, device="cpu", config=str(PRESETS[algo]),
    )  # fmt: skip
    theirs, _ = manager.setup_experiment()
    config = load_config(algo, env_id, seed=3)
    venv = build_vec_env(config)
    ours = build_model(config, venv)
    assert type(theirs) is type(ours)
    assert theirs.env.observation_space == venv.observation_space
    assert (manager.n_timesteps, manager.n_envs) == (config.n_timesteps, config.n_envs)
    assert manager.normalize == config.normalize
    assert tuple(manager.monitor_kwargs["info_keywords"]) == MUSIC
    compared = config.algorithm_kwargs.keys() - {"policy_kwargs", "learning_rate", "clip_range"}
    for name in compared:
        assert getattr(theirs, name) == getattr(ours, name), name
    assert theirs.lr_schedule(1) == theirs.lr_schedule(0) == ours.lr_schedule(0.5)
    if algo == "ppo":
        assert theirs.clip_range(1) == theirs.clip_range(0) == ours.clip_range(0.5)
    noise = theirs.action_noise if algo in OFF_POLICY else None
    assert repr(noise) == repr(getattr(ours, "action_noise", None))
    weights = ours.policy.state_dict()
    assert all(torch.equal(v, weights[name]) for name, v in theirs.policy.state_dict().items())
    venv.close()
    theirs.env.close()
