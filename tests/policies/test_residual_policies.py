"""Policies that begin with what they are added to."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import SAC, TD3
from torch import nn

from sb3_piano.policies import ResidualSACPolicy, ResidualTD3Policy

ALGORITHMS = [(SAC, ResidualSACPolicy), (TD3, ResidualTD3Policy)]
IDS = ["sac", "td3"]


@pytest.fixture(params=ALGORITHMS, ids=IDS)
def model(request):
    algorithm, policy = request.param
    return algorithm(
        policy,
        gym.make("Pendulum-v1"),
        policy_kwargs={"net_arch": [16, 8], "dropout": 0.02},
        buffer_size=200,
        learning_starts=20,
        seed=0,
    )


def observations():
    return np.random.default_rng(0).normal(size=(50, 3)).astype(np.float32)


def test_its_actions_are_0_until_it_has_learnt_something(model):
    actions, _ = model.predict(observations(), deterministic=True)
    np.testing.assert_array_equal(actions, np.zeros((50, 1)))
    model.learn(30)
    actions, _ = model.predict(observations(), deterministic=True)
    assert len(np.unique(actions)) == 50


def test_the_hidden_layers_and_the_critics_begin_at_random(model):
    hidden = model.actor.latent_pi if isinstance(model, SAC) else model.actor.mu[:-2]
    assert any(layer.weight.any() for layer in hidden if isinstance(layer, nn.Linear))
    torch.manual_seed(0)
    values = model.critic(torch.rand(20, 3), torch.rand(20, 1))
    assert all(value.unique().numel() == 20 for value in values)


def test_the_critics_are_regularised(model):
    kinds = [type(layer) for layer in model.critic.q_networks[0]]
    assert kinds[:4] == [nn.Linear, nn.Dropout, nn.LayerNorm, nn.ReLU]
    assert model.critic.q_networks[0][1].p == 0.02


def test_sac_explores_from_the_beginning():
    model = SAC(ResidualSACPolicy, gym.make("Pendulum-v1"), buffer_size=200, seed=0)
    torch.manual_seed(0)
    actions, _ = model.predict(observations(), deterministic=False)
    assert actions.std() > 0.5


def test_a_saved_model_plays_the_same(model, tmp_path):
    model.learn(30)
    model.save(tmp_path / "model")
    loaded = type(model).load(tmp_path / "model")
    assert type(loaded.policy) is type(model.policy)
    np.testing.assert_array_equal(
        loaded.predict(observations(), deterministic=True)[0],
        model.predict(observations(), deterministic=True)[0],
    )
