"""Updates without what changes nothing: the same gradients, the same learning."""

import contextlib

import gymnasium as gym
import numpy as np
import pytest
import torch
from acting import Noted
from gymnasium import spaces
from sb3_contrib import TQC, CrossQ
from stable_baselines3 import DDPG, PPO, SAC, TD3
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv
from torch import nn

from sb3_piano.policies import EncoderSACPolicy, RegularizedSACPolicy, fast_updates
from sb3_piano.policies.batched_critics import batched_critics
from sb3_piano.policies.sparing import ZeroSkippingLinear, sparing_updates
from sb3_piano.training import load_config, train

STOCK = {"sac": SAC, "td3": TD3, "ddpg": DDPG, "tqc": TQC, "crossq": CrossQ}
ALGORITHMS = {name: (algorithm, "MlpPolicy", {}) for name, algorithm in STOCK.items()}
ALGORITHMS["regularized"] = (SAC, RegularizedSACPolicy, {"dropout": 0.0})
ALGORITHMS["encoder"] = (SAC, EncoderSACPolicy, {"dropout": 0.0})
SMALL = {"learning_starts": 20, "buffer_size": 100}


def make(algorithm=SAC, policy="MlpPolicy", policy_kwargs=None, **env_kwargs):
    env = gym.make("RoboPianist-debug-CMajorScaleOneHand-v0", physics="fast", **env_kwargs)
    kwargs = {"policy_kwargs": {"net_arch": [24, 16], **(policy_kwargs or {})}, **SMALL}
    return algorithm(policy, env, batch_size=32, seed=0, **kwargs)


def learnt(model):
    return {name: value.detach().clone() for name, value in model.policy.state_dict().items()}


def update(model, times=3):
    set_random_seed(0)  # what buffers and policies draw from
    model.train(gradient_steps=times, batch_size=32)
    return learnt(model)


def like(model):
    """Return another model with the same networks, transitions and optimizers."""
    algorithm, env, policy = type(model), model.get_env(), model.policy_class
    other = algorithm(policy, env, policy_kwargs=model.policy_kwargs, **SMALL)
    other.set_parameters(model.get_parameters())
    other.replay_buffer, other._logger = model.replay_buffer, model.logger
    return other


@pytest.mark.parametrize("name", ALGORITHMS)
def test_updates_learn_the_same_but_for_rounding(name):
    stock = make(*ALGORITHMS[name])
    stock.learn(20)
    before, sparing = learnt(stock), like(stock)
    expected = update(stock)
    with fast_updates(sparing):
        found = update(sparing)
    changed = [key for key, value in expected.items() if not torch.equal(value, before[key])]
    assert any(key.startswith("actor") for key in changed)
    assert any(key.startswith("critic") for key in changed)
    for key, value in expected.items():
        torch.testing.assert_close(found[key], value, rtol=1e-3, atol=2e-5, msg=key)


def test_an_actors_update_differentiates_by_no_weight_of_the_critics():
    model = make()
    observations = torch.rand(8, model.observation_space.shape[0])
    with fast_updates(model):
        actions = torch.zeros(8, model.action_space.shape[0], requires_grad=True)
        torch.cat(model.critic(observations, actions)).sum().backward()
        assert all(parameter.grad is None for parameter in model.critic.parameters())
        assert actions.grad.abs().sum() > 0
        torch.cat(model.critic(observations, actions.detach())).sum().backward()
    assert all(parameter.grad is not None for parameter in model.critic.parameters())


def test_actions_have_their_gradient_also_where_all_of_them_are_zero():
    model = make(TD3)
    observations = torch.zeros(8, model.observation_space.shape[0])
    observations[:, 3] = 1.0
    gradients = []
    for context in (contextlib.nullcontext(), fast_updates(model)):
        actions = torch.zeros(8, model.action_space.shape[0], requires_grad=True)
        with context:
            model.critic.q1_forward(observations, actions).sum().backward()
        gradients.append(actions.grad)
    assert (gradients[0] != 0).any(dim=1).all()
    torch.testing.assert_close(gradients[1], gradients[0])


def test_columns_of_zeros_are_left_out_and_their_weights_have_no_gradient():
    layer = nn.Linear(6, 3)
    rows = torch.rand(4, 6)
    rows[:, [0, 2, 3]] = 0.0
    expected = layer(rows)
    layer.__class__ = ZeroSkippingLinear
    found = layer(rows)
    torch.testing.assert_close(found, expected)
    found.sum().backward()
    assert (layer.weight.grad != 0).any(dim=0).tolist() == [False, True, False, False, True, True]
    rows = torch.zeros(4, 6)
    rows[2, 1] = float("nan")  # a number that is not finite is seen
    assert layer(rows).isnan().any(dim=1).tolist() == [False, False, True, False]


def test_dense_batches_are_searched_for_zeros_only_now_and_then():
    layer, full, half = nn.Linear(6, 3), torch.rand(4, 6), torch.rand(4, 6)
    half[:, :3] = 0.0
    layer.__class__ = ZeroSkippingLinear
    layer(full)
    layer(half).sum().backward()
    assert layer.dense_for > 0
    for _ in range(layer.dense_for + 1):
        layer(half)
    assert layer.dense_for == 0
    torch.testing.assert_close(layer(half), nn.functional.linear(half, layer.weight, layer.bias))


def test_target_networks_follow_to_the_same_numbers_as_in_sb3():
    model = make(TD3)
    expected, target = ([torch.rand(5, 3), torch.rand(7)] for _ in range(2))
    found = [one.clone() for one in target]
    stock = TD3.train.__globals__["polyak_update"]
    stock(expected, target, 0.3)
    with fast_updates(model):
        ours = TD3.train.__globals__["polyak_update"]
        assert ours is not stock
        ours(expected, found, 0.3)
        assert [*model.critic.parameters()] == [*nn.Module.parameters(model.critic)]
    assert TD3.train.__globals__["polyak_update"] is stock
    assert "parameters" not in vars(model.critic)
    assert all(torch.equal(*pair) for pair in zip(found, target, strict=True))


@pytest.mark.parametrize("name", ["sac", "td3"])
def test_afterwards_the_model_is_as_before_and_one_without_critics_of_actions_is_left_alone(name):
    model = make(*ALGORITHMS[name])
    modules, attributes = kinds(model), set(vars(model.critic))
    with fast_updates(model):
        assert ZeroSkippingLinear in kinds(model)
        with pytest.raises(RuntimeError):  # of other shapes
            model.critic(torch.zeros(2, 3), torch.zeros(2, 3, requires_grad=True))
        assert all(parameter.requires_grad for parameter in model.critic.parameters())
    assert kinds(model) == modules
    assert set(vars(model.critic)) == attributes
    on_policy = PPO("MlpPolicy", "Pendulum-v1", n_steps=8, batch_size=8)
    modules = kinds(on_policy)
    with fast_updates(on_policy):
        assert kinds(on_policy) == modules


def kinds(model):
    return [type(module) for module in model.policy.modules()]


def fused(model):
    optimizers = [model.actor.optimizer, model.critic.optimizer, model.ent_coef_optimizer]
    return [group["fused"] for optimizer in optimizers for group in optimizer.param_groups]


@pytest.mark.parametrize(
    ("chosen", "meanwhile"),
    [
        ({}, [True] * 3),
        # What was chosen is kept; the entropy coefficient has SB3's own Adam.
        ({"optimizer_kwargs": {"fused": False}}, [False, False, True]),
        ({"optimizer_kwargs": {"foreach": True}}, [None, None, True]),
        ({"optimizer_class": torch.optim.SGD}, [None, None, True]),
    ],
    ids=str,
)
def test_adam_passes_over_the_weights_once_meanwhile_unless_told_otherwise(chosen, meanwhile):
    model = make(policy_kwargs=chosen)
    before = fused(model)
    with fast_updates(model):
        assert fused(model) == meanwhile
    assert fused(model) == before


def test_a_run_trains_so(tmp_path):
    look = Noted(lambda own: type(own.model.critic.q_networks[0][0]))
    config = load_config(
        "sac", "RoboPianist-debug-CMajorScaleOneHand-v0", n_timesteps=3, learning_starts=1, seed=0
    )
    train(config, tmp_path / "run", callbacks=[look], progress_bar=False)
    assert look.seen == [ZeroSkippingLinear] * 3


def test_the_name_up_to_0_2_still_works_and_says_the_new_one():
    model = make()
    with pytest.warns(DeprecationWarning, match="is now fast_updates"):
        context = sparing_updates(model)
    with context:
        assert "forward" in vars(model.critic)
    assert "forward" not in vars(model.critic)


# Batched critics give what critics one by one give.


class Points(DummyVecEnv):
    """Spaces alone, for a model."""

    def __init__(self, inputs=7, actions=3):
        self.num_envs, self.render_mode, self.reset_infos = 1, None, [{}]
        self.observation_space = spaces.Box(-1, 1, (inputs,))
        self.action_space = spaces.Box(-1, 1, (actions,))


def critics(algorithm=SAC, policy="MlpPolicy", **options):
    network = {"net_arch": [16, 16], **options}
    model = algorithm(policy, Points(), policy_kwargs=network, seed=0, device="cpu")
    return model.critic


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize(
    ("algorithm", "policy", "options"),
    [
        (SAC, "MlpPolicy", {"activation_fn": nn.Tanh}),
        (TD3, "MlpPolicy", {}),
        (SAC, RegularizedSACPolicy, {"dropout": 0.0, "layer_norm": False, "mean_q": True}),
    ],
)
def test_values_and_gradients_are_equal_but_for_rounding(algorithm, policy, options, count):
    critic = critics(algorithm, policy, n_critics=count, **options)
    obs, actions = torch.randn(9, 7), torch.randn(9, 3, requires_grad=True)
    found = []
    for change in (contextlib.nullcontext(False), batched_critics(critic)):
        with change as changed:
            values = critic(obs, actions)
        assert changed == bool(found)
        loss = sum(((value - 1) ** 2).sum() for value in values)
        gradients = torch.autograd.grad(loss, [actions, *critic.parameters()])
        found.append([*values, *gradients])
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one.detach(), other.detach(), atol=1e-5)
    assert not {"each", "forward"} & set(vars(critic))


@pytest.mark.parametrize("critic", [critics(n_critics=1), critics(TQC), None])
def test_other_critics_stay_as_they_are(critic):
    with batched_critics(critic) as changed:
        assert not changed
