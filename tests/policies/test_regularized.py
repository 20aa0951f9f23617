"""Critics with dropout and layer normalisation, under stock SAC and TD3."""

from __future__ import annotations

import copy

import gymnasium as gym
import pytest
import torch
from stable_baselines3 import SAC, TD3
from torch import nn

from sb3_piano.exceptions import ConfigError
from sb3_piano.policies import RegularizedSACPolicy, RegularizedTD3Policy

ALGORITHMS = [(SAC, RegularizedSACPolicy), (TD3, RegularizedTD3Policy)]
IDS = ["sac", "td3"]


def make(algorithm, policy, **policy_kwargs):
    env = gym.make("RoboPianist-debug-CMajorScaleOneHand-v0", observation="fingers", physics="fast")
    return algorithm(
        policy,
        env,
        policy_kwargs={"net_arch": [16, 8], **policy_kwargs},
        buffer_size=200,
        learning_starts=20,
        seed=0,
    )


def kinds(network):
    return [type(layer) for layer in network]


def transitions(model, count=32):
    torch.manual_seed(0)
    observations = torch.rand(count, model.observation_space.shape[0])
    return observations, torch.rand(count, model.action_space.shape[0])


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_a_hidden_layer_is_linear_dropout_normalisation_relu(algorithm, policy):
    model = make(algorithm, policy, dropout=0.02)
    hidden = [nn.Linear, nn.Dropout, nn.LayerNorm, nn.ReLU]
    for critic in (model.critic, model.critic_target):
        assert len(critic.q_networks) == 2
        for network in critic.q_networks:
            assert kinds(network) == [*hidden, *hidden, nn.Linear]
            assert [layer.out_features for layer in network if isinstance(layer, nn.Linear)] == [
                16,
                8,
                1,
            ]
            assert network[1].p == 0.02


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_only_the_critics_are_regularised(algorithm, policy):
    layers = list(make(algorithm, policy).actor.modules())
    assert not any(isinstance(layer, nn.Dropout | nn.LayerNorm) for layer in layers)


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_either_can_be_left_out(algorithm, policy):
    model = make(algorithm, policy, dropout=0.0)
    assert kinds(model.critic.q_networks[0])[:3] == [nn.Linear, nn.LayerNorm, nn.ReLU]
    model = make(algorithm, policy, layer_norm=False)
    assert kinds(model.critic.q_networks[0])[:3] == [nn.Linear, nn.Dropout, nn.ReLU]


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_critics_drop_out_while_training_and_targets_never(algorithm, policy):
    model = make(algorithm, policy, dropout=0.5)
    model.policy.set_training_mode(True)
    inputs = transitions(model)
    for critic, same in ((model.critic, False), (model.critic_target, True)):
        first, second = critic(*inputs)[0], critic(*inputs)[0]
        assert torch.equal(first, second) == same


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_training_changes_all_weights_of_the_critics_and_moves_the_targets(algorithm, policy):
    model = make(algorithm, policy)
    before = copy.deepcopy(model.critic.state_dict())
    target = copy.deepcopy(model.critic_target.state_dict())
    # As many parameters as optimised: none is left over from critics that were replaced.
    optimised = [p for group in model.critic.optimizer.param_groups for p in group["params"]]
    assert len(optimised) == len(list(model.critic.parameters())) == len(before)
    model.learn(40)
    for name, weights in model.critic.state_dict().items():
        assert not torch.equal(weights, before[name]), name
    assert not torch.equal(model.critic_target.state_dict()["qf0.0.weight"], target["qf0.0.weight"])


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_a_model_is_the_same_after_saving_and_loading(algorithm, policy, tmp_path):
    model = make(algorithm, policy, dropout=0.03, layer_norm=False)
    model.save(tmp_path / "model.zip")
    loaded = algorithm.load(tmp_path / "model.zip")
    assert loaded.critic.q_networks[0][1].p == 0.03
    inputs = transitions(model)
    for network in (model, loaded):
        network.policy.set_training_mode(False)
    assert torch.equal(model.critic(*inputs)[1], loaded.critic(*inputs)[1])
    model.policy.save(tmp_path / "policy.pt")
    alone = policy.load(tmp_path / "policy.pt")
    assert kinds(alone.critic.q_networks[0]) == kinds(model.critic.q_networks[0])


@pytest.mark.parametrize("dropout", [-0.1, 1.0])
def test_a_dropout_out_of_range_is_refused(dropout):
    with pytest.raises(ConfigError, match=rf"dropout is {dropout}: expected .* and below 1"):
        make(SAC, RegularizedSACPolicy, dropout=dropout)


@pytest.mark.parametrize(("algorithm", "policy"), ALGORITHMS, ids=IDS)
def test_actions_cost_their_mean_square_where_they_are_optimised_and_nowhere_else(
    algorithm, policy, tmp_path
):
    cost = 0.3
    plain, model = (make(algorithm, policy, dropout=0.0, action_cost=c) for c in (0.0, cost))
    observations, actions = transitions(model)
    for ask in ("forward", "q1_forward"):
        found = []
        for critic in (plain.critic, model.critic):
            given = actions.clone().requires_grad_()
            value = getattr(critic, ask)(observations, given)
            first = value[0] if isinstance(value, tuple) else value
            (gradient,) = torch.autograd.grad(first.sum(), given)
            found.append((first.detach(), gradient))
        (value, gradient), (less, other) = found
        wanted = cost * actions.square().mean(dim=1, keepdim=True)
        torch.testing.assert_close(value - less, wanted)
        torch.testing.assert_close(gradient - other, 2 * cost * actions / actions.shape[1])
    for one, same in zip(
        plain.critic(observations, actions), model.critic(observations, actions), strict=True
    ):
        assert torch.equal(one, same)
    model.save(tmp_path / "model.zip")
    loaded = algorithm.load(tmp_path / "model.zip")
    assert loaded.policy._get_constructor_parameters()["action_cost"] == cost
    with pytest.raises(ConfigError, match="action_cost is -1: expected"):
        make(algorithm, policy, action_cost=-1)
