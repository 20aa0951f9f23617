"""Regularised critics, SimBa and encoders: each learns a real piece under each algorithm."""

import copy
import functools

import gymnasium as gym
import numpy as np
import pytest
import torch
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3
from yaml_rows import Tables

from sb3_piano import policies
from sb3_piano.wrappers import Lookahead, PreviousActionReward

ALGORITHMS = {"SAC": SAC, "TD3": TD3, "TQC": TQC}
KINDS = Tables(__file__)["kinds"]
SMALL = {"batch_size": 16, "buffer_size": 100, "learning_starts": 8, "seed": 0, "device": "cpu"}
TAU = 0.25


@functools.cache
def piano():
    env = gym.make(
        "RoboPianist-debug-CMajorScaleOneHand-v0", physics="fast", reduced_action_space=True
    )
    return PreviousActionReward(Lookahead(env, steps=10, fingers=True))


@pytest.fixture(
    scope="module",
    params=[(name, kind) for name in ALGORITHMS for kind in KINDS],
    ids=lambda param: "-".join(param),
)
def trained(request):
    """A model after 12 steps and four updates, and its weights before the last update."""
    name, kind = request.param
    prefix, policy_kwargs = KINDS[kind]
    kwargs = {"policy_kwargs": dict(policy_kwargs)}  # to which SB3 adds some
    kwargs |= {"policy_delay": 1} if name == "TD3" else {}
    policy = getattr(policies, f"{prefix}{name}Policy")
    model = ALGORITHMS[name](policy, piano(), tau=TAU, **SMALL, **kwargs)
    model.learn(11)
    before = copy.deepcopy(model.policy.state_dict())
    model.train(gradient_steps=1, batch_size=16)
    return model, before


def test_an_update_changes_every_weight_of_actor_and_critics(trained):
    model, before = trained
    for part in ("actor", "critic"):
        for name, weights in getattr(model, part).named_parameters():
            assert not torch.equal(weights, before[f"{part}.{name}"]), name


def test_target_critics_follow_the_critics_and_do_nothing_else(trained):
    model, before = trained
    critics = dict(model.critic.named_parameters())
    for name, weights in model.critic_target.named_parameters():
        wanted = (1 - TAU) * before[f"critic_target.{name}"] + TAU * critics[name]
        torch.testing.assert_close(weights, wanted, msg=name)
        assert not weights.grad


def test_the_optimizers_have_each_weight_once_and_none_that_was_replaced(trained):
    model, _ = trained
    for part in (model.actor, model.critic):
        optimised = [id(p) for group in part.optimizer.param_groups for p in group["params"]]
        assert sorted(optimised) == sorted(id(p) for p in part.parameters())


@pytest.mark.slow
def test_stock_load_gives_the_same_actions_and_goes_on_learning(trained, tmp_path):
    model, _ = trained
    model.save(tmp_path / "model.zip")
    loaded = type(model).load(tmp_path / "model.zip", env=piano(), device="cpu")
    observations = np.stack([model.observation_space.sample() for _ in range(8)])
    observations[:, -1] = 0  # the previous reward has no bounds
    actions = model.predict(observations, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], actions)
    assert len(np.unique(actions, axis=0)) == 8
    model.policy.save(tmp_path / "policy.pt")
    alone = type(model.policy).load(tmp_path / "policy.pt", device="cpu")
    assert repr(alone) == repr(loaded.policy) == repr(model.policy)  # layers and their settings
    for name, weights in model.policy.state_dict().items():
        assert torch.equal(loaded.policy.state_dict()[name], weights), name
    np.testing.assert_array_equal(alone.predict(observations, deterministic=True)[0], actions)
    loaded.replay_buffer = model.replay_buffer
    loaded.learn(2, reset_num_timesteps=False)
    assert (loaded.predict(observations, deterministic=True)[0] != actions).any()
