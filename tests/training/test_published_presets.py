"""Presets of one publication each."""

import argparse
import contextlib
from pathlib import Path

import pytest
import torch
from torch import nn

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.callbacks import F1Callback
from sb3_piano.hyperparams import NAMED
from sb3_piano.training import load_config
from sb3_piano.training.runs.builders import build_callbacks, build_model, build_vec_env

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
BRIEF = {"learning_starts": 16, "buffer_size": 64, "batch_size": 8, "n_envs": 1}
PUBLISHED = [(name, algo) for name, files in NAMED.items() if name != "fast" for algo in files]
CELLS = Path(__file__).parents[2] / "examples" / "sac_vs_td3"


@contextlib.contextmanager
def made(name, algo):
    config = load_config(algo, ENV_ID, name, seed=0, **BRIEF)
    with contextlib.closing(build_vec_env(config)) as venv:
        yield build_model(config, venv)


def test_there_are_those_of_three_publications():
    assert PUBLISHED == [
        ("robopianist", "sac"),
        ("robovirtuoso", "sac"),
        ("sac_vs_td3", "sac"),
        ("sac_vs_td3", "td3"),
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "algo"), PUBLISHED)
def test_they_train(name, algo):
    config = load_config(algo, ENV_ID, name, seed=0)
    callback, *_ = build_callbacks(config)
    assert callback.eval_freq < config.n_timesteps <= 5 * config.algorithm_kwargs["buffer_size"]
    with made(name, algo) as model:
        before = {key: value.clone() for key, value in model.actor.state_dict().items()}
        model.learn(24)
        after = model.actor.state_dict()
    assert all(torch.isfinite(value).all() for value in after.values())
    assert any(not torch.equal(value, before[key]) for key, value in after.items())


@pytest.mark.parametrize("name", ["robopianist", "robovirtuoso"])
def test_the_last_action_and_reward_are_observed(name):
    with made(name, "sac") as model:
        layout = model.observation_space.layout
        assert layout["previous_action"].size == model.action_space.shape[0] == 39
        assert model.target_entropy == -39 / 2
        layers = {type(layer) for layer in model.critic.modules()}
        assert {nn.Dropout, nn.LayerNorm, nn.GELU} <= layers
        assert nn.LayerNorm not in {type(layer) for layer in model.actor.modules()}


def test_robovirtuosos_actor_has_its_size():
    """Table 4 has 477,006 with six numbers more, which are observed there: the hands' places."""
    with made("robovirtuoso", "sac") as model:
        size = sum(parameter.numel() for parameter in model.actor.parameters())
    assert size + 6 * 256 == 477_006


@pytest.mark.parametrize("algo", ["sac", "td3"])
def test_the_study_of_sac_and_td3_is_that_of_its_cells(algo):
    cell = load_config(algo, ENV_ID, CELLS / algo / "c_major.yml", seed=0)
    assert load_config(algo, ENV_ID, "sac_vs_td3", seed=0) == cell


@pytest.mark.slow
@pytest.mark.parametrize(("name", "algo"), [("fast", "sac"), *PUBLISHED])
def test_they_train_in_the_stock_zoo(name, algo, tmp_path):
    manager = pytest.importorskip("rl_zoo3.exp_manager").ExperimentManager(
        argparse.Namespace(), algo, ENV_ID, str(tmp_path), n_timesteps=32, eval_freq=-1, seed=0,
        verbose=0, device="cpu", config=str(NAMED[name][algo]), hyperparams=BRIEF,
    )  # fmt: skip
    model, _ = manager.setup_experiment()
    callback = next(c for c in manager.callbacks if isinstance(c, F1Callback))
    callback.eval_freq, callback._n_episodes = 16, 1
    manager.learn(model)
    assert model.num_timesteps == 32
    assert callback.evaluations_metrics[0][0]["noop_f1"] > 0
    assert model.replay_buffer.size() > 0
    assert isinstance(model.replay_buffer, CompactReplayBuffer)
