"""The presets: every file has settings for every id, here and in the stock zoo alike.

Those of one publication each, and our own for learning a piece from nothing ("fast"), too.
"""

import argparse
import contextlib
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize
from torch import nn

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.callbacks import F1Callback
from sb3_piano.envs import DEBUG_IDS, GENERAL_ID, SELF_ACTUATED_ID
from sb3_piano.exceptions import ConfigError
from sb3_piano.hyperparams import NAMED, PRESETS
from sb3_piano.music import Note, Score, write_midi
from sb3_piano.training import evaluate, load_config, train
from sb3_piano.training.configuration.entries import zoo_preset
from sb3_piano.training.playing.player_files import write_player
from sb3_piano.training.runs.builders import build_callbacks, build_model, build_vec_env
from sb3_piano.vec_env import HandsAsAgents

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
TWO_HANDS = "RoboPianist-debug-CMajorScaleTwoHands-v0"
FAST = [("fast", algo) for algo in NAMED["fast"]]
OURS = ("batched", "fast")
PUBLISHED = [(name, algo) for name, files in NAMED.items() if name not in OURS for algo in files]
CELLS = Path(__file__).parents[2] / "examples" / "sac_vs_td3"


@contextlib.contextmanager
def made(algo, env_id, name=None, **changes):
    """Give the model of a preset in its environment."""
    config = load_config(algo, env_id, name, seed=3, **changes)
    with contextlib.closing(build_vec_env(config)) as venv:
        yield build_model(config, venv)


@pytest.mark.parametrize("algo", sorted((*OFF_POLICY, "ppo")))
def test_a_file_has_a_default_and_an_entry_for_each_debug_piece(algo):
    others = [SELF_ACTUATED_ID] if algo == "ppo" else []
    entries = list(yaml.safe_load(PRESETS[algo].read_text()))
    assert entries == ["default", *DEBUG_IDS, *others]
    assert list(PRESETS) == sorted((*OFF_POLICY, "ppo"))


@pytest.mark.parametrize("algo", PRESETS)
def test_every_file_has_valid_settings_for_every_id(algo):
    """A replay buffer is compact and holds the whole training, or all batches are full."""
    for env_id in IDS:
        config = load_config(algo, env_id)
        assert (config.algo, config.env_id, config.policy) == (algo, env_id, "MlpPolicy")
        assert config.monitor_kwargs == {"info_keywords": MUSIC}
        assert [plugin.path for plugin in config.callback] == ["sb3_piano.callbacks.F1Callback"]
        (callback,) = build_callbacks(config)
        assert callback.eval_freq * config.n_envs < config.n_timesteps  # it does evaluate
        short = {"observation": "fingers", "physics": "fast"}
        assert config.env_kwargs == ({} if env_id == GENERAL_ID else short)
        arguments = config.algorithm_kwargs
        assert arguments["gamma"] == 0.8
        if algo == "ppo":
            assert config.n_envs * arguments["n_steps"] % arguments["batch_size"] == 0
            assert config.normalize is True
        else:
            assert arguments["replay_buffer_class"] == "sb3_piano.buffers.CompactReplayBuffer"
            assert arguments["buffer_size"] >= config.n_timesteps


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


@pytest.mark.parametrize("algo", ["ddpg", "sac", "td3", "tqc"])
def test_the_general_entry_has_the_published_values(algo):
    config = load_config(algo, GENERAL_ID)
    published = {"tau": 0.005, "learning_rate": 0.0003, "batch_size": 256, "train_freq": 1}
    published |= {"buffer_size": 1_000_000, "learning_starts": 5000, "gradient_steps": 1}
    assert config.algorithm_kwargs.items() >= published.items()
    assert config.algorithm_kwargs["policy_kwargs"]["net_arch"] == [256, 256, 256]
    assert (config.n_timesteps, config.callback[0].kwargs) == (1_000_000, {"eval_freq": 10000})


def test_the_variants_of_an_algorithm_have_its_settings_where_both_have_them():
    for variant, origin in (("tqc", "sac"), ("crossq", "sac"), ("ddpg", "td3")):
        config, other = load_config(variant, DEBUG_IDS[0]), load_config(origin, DEBUG_IDS[0])
        assert (config.noise_type, config.noise_std) == (other.noise_type, other.noise_std)
        own, others = config.algorithm_kwargs, other.algorithm_kwargs
        shared = (own.keys() & others.keys()) - {"policy_kwargs"}
        assert len(shared) >= 8
        assert {name: own[name] for name in shared} == {name: others[name] for name in shared}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "algo", "env_id"),
    [*((None, *entry) for entry in ENTRIES), *((*each, TWO_HANDS) for each in [*FAST, *PUBLISHED])],
)
def test_a_preset_trains(name, algo, env_id):
    alone = {} if name is None else {"n_envs": 1}
    with made(algo, env_id, name, **BRIEF[algo], **alone) as model:
        before = {key: value.clone() for key, value in model.policy.state_dict().items()}
        model.learn(STEPS)
    after = model.policy.state_dict()
    assert all(torch.isfinite(value).all() for value in after.values())
    assert any(not torch.equal(value, before[key]) for key, value in after.items())
    learned = {k: v for k, v in model.logger.name_to_value.items() if k.startswith("train/")}
    assert any("loss" in key for key in learned)
    assert all(np.isfinite(value) for value in learned.values()), learned
    if isinstance(model, OffPolicyAlgorithm):
        assert isinstance(model.replay_buffer, CompactReplayBuffer)
        assert model.replay_buffer.size() == STEPS // model.n_envs
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


def test_there_are_presets_of_three_publications_which_are_evaluated():
    assert PUBLISHED == [
        ("robopianist", "sac"),
        ("robovirtuoso", "sac"),
        ("sac_vs_td3", "sac"),
        ("sac_vs_td3", "td3"),
    ]
    for name, algo in PUBLISHED:
        config = load_config(algo, TWO_HANDS, name)
        callback, *_ = build_callbacks(config)
        buffer_size = config.algorithm_kwargs["buffer_size"]
        assert callback.eval_freq < config.n_timesteps <= 5 * buffer_size


@pytest.mark.parametrize("name", ["robopianist", "robovirtuoso"])
def test_the_last_action_and_reward_are_observed(name):
    with made("sac", TWO_HANDS, name, **BRIEF["sac"], n_envs=1) as model:
        layout = model.observation_space.layout
        assert layout["previous_action"].size == model.action_space.shape[0] == 39
        assert model.target_entropy == -39 / 2
        layers = {type(layer) for layer in model.critic.modules()}
        assert {nn.Dropout, nn.LayerNorm, nn.GELU} <= layers
        assert nn.LayerNorm not in {type(layer) for layer in model.actor.modules()}
        size = sum(parameter.numel() for parameter in model.actor.parameters())
    # Table 4 has six numbers more, which are observed there: the hands' places.
    assert name == "robopianist" or size + 6 * 256 == 477_006


@pytest.mark.slow
@pytest.mark.parametrize(("name", "algo"), [("fast", "td3"), ("robovirtuoso", "sac")])
def test_named_presets_train_in_the_stock_zoo(name, algo, tmp_path):
    file = tmp_path / "zoo.yml"
    file.write_text(zoo_preset(algo, name))
    manager = pytest.importorskip("rl_zoo3.exp_manager").ExperimentManager(
        argparse.Namespace(), algo, TWO_HANDS, str(tmp_path), n_timesteps=32, eval_freq=-1, seed=0,
        verbose=0, device="cpu", config=str(file),
        hyperparams={**BRIEF[algo], "n_envs": 1},
    )  # fmt: skip
    model, _ = manager.setup_experiment()
    callback = next(c for c in manager.callbacks if isinstance(c, F1Callback))
    callback.eval_freq, callback._n_episodes = 16, 1
    manager.learn(model)
    assert model.num_timesteps == 32
    assert callback.evaluations_metrics[0][0]["noop_f1"] > 0
    assert model.replay_buffer.size() > 0
    assert isinstance(model.replay_buffer, CompactReplayBuffer)


def test_the_name_stands_for_the_file():
    assert list(NAMED["fast"]) == ["sac", "td3", "tqc"]
    config = load_config("sac", "RoboPianist-v0", "fast", seed=0)
    assert config == load_config("sac", "RoboPianist-v0", NAMED["fast"]["sac"], seed=0)
    assert config != load_config("sac", "RoboPianist-v0", PRESETS["sac"], seed=0)
    for algo in ("sac", "td3"):  # the study of both is that of its cells
        cell = load_config(algo, TWO_HANDS, CELLS / algo / "c_major.yml", seed=0)
        assert load_config(algo, TWO_HANDS, "sac_vs_td3", seed=0) == cell
    with pytest.raises(ConfigError, match="No preset 'fast' comes with this package for 'ddpg'"):
        load_config("ddpg", "RoboPianist-v0", "fast")
    with pytest.raises(ConfigError, match=r"no preset of that name.* Did you mean 'fast'\?"):
        load_config("sac", "RoboPianist-v0", "fest")


@pytest.mark.parametrize("env_id", [TWO_HANDS, GENERAL_ID])
def test_every_hand_is_an_agent_that_sees_and_does_as_much(env_id):
    config = load_config("sac", env_id, "fast", seed=0, n_envs=1)
    with contextlib.closing(build_vec_env(config)) as venv:
        assert isinstance(venv, VecNormalize)
        assert isinstance(venv.venv, HandsAsAgents)
        assert venv.num_envs == 2
        entropy = config.algorithm_kwargs["target_entropy"]
        assert -2 * venv.action_space.shape[0] < entropy < -venv.action_space.shape[0]


@pytest.mark.slow
def test_fast_trains_on_any_file_and_the_run_can_be_judged_and_shared(tmp_path):
    notes = [Note(onset=0.1 * n, offset=0.1 * n + 0.1, pitch=60 + 2 * n) for n in range(3)]
    write_midi(Score(notes=notes, title="three notes"), tmp_path / "three.mid")
    settings = {"n_envs": 1, "n_timesteps": 120, "learning_starts": 60, "seed": 0}
    settings["env_kwargs"] = {"score": str(tmp_path / "three.mid")}
    config = load_config("sac", "RoboPianist-v0", "fast", **settings)
    run = train(config, tmp_path / "run", progress_bar=False).folder
    found = evaluate(run.path, physics="reference")
    assert 0 <= found.mean["f1"] <= 1
    assert found.baseline is not None
    assert evaluate(write_player(run.path, tmp_path / "shared").path).mean == found.mean
