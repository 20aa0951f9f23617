"""Critics with dropout and layer normalisation, under stock SAC and TD3."""

import gymnasium as gym
import pytest
import torch
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3
from torch import nn

from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import import_name
from sb3_piano.policies import (
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    RegularizedTQCPolicy,
    RSNorm,
)

POLICIES = {SAC: RegularizedSACPolicy, TD3: RegularizedTD3Policy, TQC: RegularizedTQCPolicy}
SMALL = {"buffer_size": 200, "learning_starts": 4, "batch_size": 4, "seed": 0, "device": "cpu"}
each = pytest.mark.parametrize("algorithm", [SAC, TD3])


def make(algorithm, env=None, **policy_kwargs):
    piano = {"id": "RoboPianist-debug-CMajorScaleOneHand-v0", "observation": "fingers"}
    kwargs = {"policy_kwargs": {"net_arch": [16, 8], **policy_kwargs}, **SMALL}
    return algorithm(POLICIES[algorithm], env or gym.make(**piano, physics="fast"), **kwargs)


def kinds(network):
    return [type(layer) for layer in network]


def transitions(model, count=32):
    torch.manual_seed(0)
    observations = torch.rand(count, model.observation_space.shape[0])
    return observations, torch.rand(count, model.action_space.shape[0])


@each
@pytest.mark.parametrize(
    ("kwargs", "hidden"),
    [
        ({"dropout": 0.02}, [nn.Linear, nn.Dropout, nn.LayerNorm, nn.ReLU]),
        ({"dropout": 0.0}, [nn.Linear, nn.LayerNorm, nn.ReLU]),
        ({"layer_norm": False}, [nn.Linear, nn.Dropout, nn.ReLU]),
    ],
)
def test_a_hidden_layer_of_critics_alone_is_linear_dropout_normalisation_relu(
    algorithm, kwargs, hidden
):
    model = make(algorithm, **kwargs)
    for critic in (model.critic, model.critic_target):
        assert len(critic.q_networks) == 2
        for network in critic.q_networks:
            assert kinds(network) == [*hidden, *hidden, nn.Linear]
            linear = [layer.out_features for layer in network if isinstance(layer, nn.Linear)]
            assert linear == [16, 8, 1]
            dropouts = [part.p for part in network if isinstance(part, nn.Dropout)]
            assert set(dropouts) <= {kwargs.get("dropout", 0.01)}
    layers = list(model.actor.modules())
    assert not any(isinstance(layer, nn.Dropout | nn.LayerNorm) for layer in layers)


@each
def test_critics_drop_out_while_training_and_targets_never(algorithm):
    model = make(algorithm, dropout=0.5)
    model.policy.set_training_mode(True)
    inputs = transitions(model)
    for critic, same in ((model.critic, False), (model.critic_target, True)):
        first, second = critic(*inputs)[0], critic(*inputs)[0]
        assert torch.equal(first, second) == same


@pytest.mark.parametrize("dropout", [-0.1, 1.0])
def test_a_dropout_out_of_range_is_refused(dropout):
    with pytest.raises(ConfigError, match=rf"dropout is {dropout}: expected .* and below 1"):
        make(SAC, dropout=dropout)


@each
def test_actions_cost_their_mean_square_where_they_are_optimised_and_nowhere_else(
    algorithm, tmp_path
):
    cost = 0.3
    plain, model = (make(algorithm, dropout=0.0, action_cost=c) for c in (0.0, cost))
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
        make(algorithm, action_cost=-1)


def make_droq(algorithm, **policy_kwargs):
    droq = {"net_arch": [16], "target_dropout": True, "mean_q": True}
    return make(algorithm, "Pendulum-v1", **droq, **policy_kwargs)


@pytest.mark.parametrize("algorithm", POLICIES)
def test_droq_drops_out_in_critics_and_targets_throughout_updates_and_nowhere_else(algorithm):
    model = make_droq(algorithm, dropout=0.5)
    active = {"critic": [], "critic_target": []}
    for name, heard in active.items():
        for network in getattr(model, name).q_networks:
            assert kinds(network) == [nn.Linear, nn.Dropout, nn.LayerNorm, nn.ReLU, nn.Linear]
            network[1].register_forward_hook(lambda layer, *_, h=heard: h.append(layer.training))
    model.learn(4)
    model.train(gradient_steps=3, batch_size=4)
    for name, heard in active.items():
        assert len(heard) >= 6, name
        assert all(heard), name
    inputs = transitions(model)
    for training in (True, False):
        model.policy.set_training_mode(training)
        for critic in (model.critic, model.critic_target):
            first, second = (torch.as_tensor(critic(*inputs)[0]) for _ in range(2))
            assert torch.equal(first, second) != training
        first, second = (model.actor(inputs[0]) for _ in range(2))
        if algorithm is TD3:
            assert torch.equal(first, second)


def test_droq_leaves_the_statistics_of_a_targets_extractor_alone():
    model = make_droq(SAC, features_extractor_class=RSNorm)
    model.policy.set_training_mode(True)
    assert model.critic_target.q_networks[0][1].training
    assert not model.critic_target.features_extractor.training
    model.learn(8)
    mean = model.critic.features_extractor.running_mean
    assert torch.equal(model.critic_target.features_extractor.running_mean, mean)


def test_droqs_actor_is_optimised_by_the_mean_of_the_critics_and_its_targets_are_not():
    for algorithm in (SAC, TD3):
        model = make_droq(algorithm, dropout=0.0, n_critics=3)
        observations, actions = transitions(model)
        with torch.no_grad():
            values = torch.stack(model.critic(observations, actions))
        assert values.shape == (3, 32, 1)
        given = actions.clone().requires_grad_()
        (mean,) = model.critic(observations, given)
        torch.testing.assert_close(mean, values.mean(dim=0))
        torch.testing.assert_close(model.critic.q1_forward(observations, given), mean)
        torch.testing.assert_close(model.critic.q1_forward(observations, actions), values[0])


@pytest.mark.parametrize("algorithm", POLICIES)
def test_a_former_droq_policy_is_loaded_and_learns_the_same(algorithm, tmp_path, monkeypatch):
    now = make_droq(algorithm, dropout=0.1).learn(8)
    former = import_name(f"sb3_piano.policies.DroQ{algorithm.__name__}Policy")
    monkeypatch.setitem(POLICIES, algorithm, former)
    old = make(algorithm, "Pendulum-v1", net_arch=[16], dropout=0.1).learn(8)
    old.save(tmp_path / "model.zip")
    loaded = algorithm.load(tmp_path / "model.zip")
    assert type(loaded.policy) is former
    for model in (now, loaded):
        for name, weights in model.policy.state_dict().items():
            assert torch.equal(weights, old.policy.state_dict()[name]), name


def test_an_action_cost_is_the_same_for_quantiles():
    model = make(TQC, dropout=0.0, action_cost=0.3)
    observations, actions = transitions(model)
    wanted = 0.3 * actions.square().mean(dim=1)[:, None, None].expand(-1, 2, 25)
    less = model.critic(observations, actions.clone().requires_grad_())
    torch.testing.assert_close(model.critic(observations, actions) - less, wanted)
