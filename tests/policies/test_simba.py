"""SimBa's networks and normalisation, which need no piano."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from episodes import as_dict
from gymnasium import spaces
from sb3_contrib import TQC
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.torch_layers import FlattenExtractor
from yaml_rows import Tables

from sb3_piano.exceptions import ConfigError
from sb3_piano.policies import RSNorm, SimbaSACPolicy, SimbaTD3Policy, SimbaTQCPolicy

tables = Tables(__file__)

POLICIES = {SAC: SimbaSACPolicy, TD3: SimbaTD3Policy, TQC: SimbaTQCPolicy}
each = pytest.mark.parametrize("algorithm", POLICIES)
SMALL = {"pi": [8], "qf": [8]}


def make(algorithm, **policy_kwargs):
    settings = {"learning_starts": 10, "batch_size": 8, "seed": 0, "device": "cpu"}
    settings["policy_kwargs"] = {"net_arch": SMALL, **policy_kwargs}
    return algorithm(POLICIES[algorithm], "Pendulum-v1", **settings)


def parameters(module):
    return sum(p.numel() for p in module.parameters())


def block(width):
    norm, hidden, output = 2 * width, (width + 1) * 4 * width, (4 * width + 1) * width
    return norm + hidden + output


@each
def test_default_networks_have_the_papers_sizes(algorithm):
    model = make(algorithm, net_arch=None)
    heads = (128 + 1) * (1 if algorithm is TD3 else 2)
    assert parameters(model.actor) == (3 + 1) * 128 + block(128) + 2 * 128 + heads
    outputs = 25 if algorithm is TQC else 1
    critic = (4 + 1) * 512 + 2 * block(512) + 2 * 512 + (512 + 1) * outputs
    assert parameters(model.critic) == 2 * critic
    assert type(model.actor.optimizer) is type(model.critic.optimizer) is torch.optim.AdamW
    assert model.critic.optimizer.param_groups[0]["weight_decay"] == 0.01


def test_a_network_is_linear_then_residual_blocks_then_normalisation():
    network = make(SAC, net_arch={"pi": [8, 8], "qf": [8]}).actor.latent_pi
    inputs = torch.randn(5, 3)
    x = network.linear(inputs)
    for part in network.blocks:
        normal = torch.nn.functional.layer_norm(x, (8,))  # its weights are 1 and 0 at first
        hidden = torch.relu(normal @ part.hidden.weight.T + part.hidden.bias)
        x = x + hidden @ part.output.weight.T + part.output.bias
    torch.testing.assert_close(network(inputs), torch.nn.functional.layer_norm(x, (8,)))


def test_statistics_are_those_of_all_batches():
    norm = RSNorm(spaces.Box(-np.inf, np.inf, (2, 2), np.float32), epsilon=1e-12)
    batches = [np.random.default_rng(n).normal(3, 2, (n, 2, 2)) for n in (1, 5, 40)]
    for batch in batches:
        norm(torch.as_tensor(batch, dtype=torch.float32))
    everything = np.concatenate(batches).reshape(46, 4)
    torch.testing.assert_close(norm.running_mean.double(), torch.tensor(everything.mean(axis=0)))
    torch.testing.assert_close(norm.running_var.double(), torch.tensor(everything.var(axis=0)))
    found = norm.eval()(torch.as_tensor(everything, dtype=torch.float32).reshape(46, 2, 2))
    torch.testing.assert_close(found.mean(dim=0), torch.zeros(4), atol=1e-5, rtol=0)
    torch.testing.assert_close(found.std(dim=0, correction=0), torch.ones(4))
    # A number that was constant so far is clipped when it changes.
    norm = RSNorm(spaces.Box(0, 1, (2,), np.float32), clip=5.0)
    norm(torch.zeros(10, 2))
    assert norm.eval()(torch.tensor([[0.0, 1.0]])).tolist() == [[0.0, 5.0]]
    model = make(SAC, features_extractor_class=FlattenExtractor)  # may take its place
    assert not any("running" in name for name in model.policy.state_dict())


@each
def test_statistics_move_in_updates_alone_and_targets_have_the_same(algorithm):
    model = make(algorithm)
    model.learn(10)  # no update yet
    model.predict(np.full((4, 3), 9.0))
    for part in (model.actor, model.critic, model.critic_target):
        assert part.features_extractor.running_count == 0
    model.learn(4, reset_num_timesteps=False)
    model.train(gradient_steps=4, batch_size=8)
    counted = model.critic.features_extractor.running_count.item()
    assert counted >= 4 * 8
    before = model.critic.features_extractor.running_mean.clone()
    assert (before != 0).all()
    model.predict(np.full((4, 3), 9.0))
    assert torch.equal(model.critic.features_extractor.running_mean, before)
    assert torch.equal(model.critic_target.features_extractor.running_mean, before)
    assert model.critic_target.features_extractor.running_count == counted


@tables("net_arch, message")
def test_a_net_arch_that_is_no_list_of_blocks_is_refused(net_arch, message):
    with pytest.raises(ConfigError, match=message):
        make(SAC, net_arch=net_arch)
    with pytest.raises(ConfigError, match="observation space is Dict.*: expected a Box"):
        SAC(SimbaSACPolicy, as_dict(gym.make("Pendulum-v1")))
