"""Policies in which one network plays every hand, under stock SAC, TD3, TQC and PPO."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from sb3_contrib import TQC
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise

from sb3_piano.exceptions import ConfigError
from sb3_piano.policies import (
    HandsActorCriticPolicy,
    HandsSACPolicy,
    HandsTD3Policy,
    HandsTQCPolicy,
    RegularizedTD3Policy,
    hand_weights,
    load_hand_weights,
    set_standardization,
)
from sb3_piano.policies.hand_network import CLIP, Standardize

N, M = 12, 4
MODELS = {"sac": SAC, "td3": TD3, "tqc": TQC, "ppo": PPO}
POLICIES = {
    "sac": HandsSACPolicy,
    "td3": HandsTD3Policy,
    "tqc": HandsTQCPolicy,
    "ppo": HandsActorCriticPolicy,
}
COLLECTING = {"learning_starts": 8, "buffer_size": 500}
NOISE = NormalActionNoise(np.zeros(2 * M), np.full(2 * M, 0.1))
OF_ALGORITHM = {
    "sac": COLLECTING,
    "tqc": COLLECTING,
    "td3": {**COLLECTING, "action_noise": NOISE},
    "ppo": {"n_steps": 32, "batch_size": 32},
}
SMALL = {"pi": [16, 8], "qf": [16], "vf": [16]}
each = pytest.mark.parametrize(
    "name", ["sac", "td3", pytest.param("tqc", marks=pytest.mark.slow), "ppo"]
)


class Reach(gym.Env):
    """Each hand's actions should be the tanh of the first numbers that it sees."""

    def __init__(self, hands=2, n=N, m=M):
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (hands * n,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (hands * m,), np.float32)
        self._hands, self._m, self._steps = hands, m, 0

    def _observe(self):
        shape = self.observation_space.shape
        self._observation = self.np_random.normal(size=shape).astype(np.float32)
        return self._observation

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._steps = 0
        return self._observe(), {}

    def step(self, action):
        wanted = np.tanh(self._observation.reshape(self._hands, -1)[:, : self._m]).ravel()
        reward = -float(np.mean((action - wanted) ** 2))
        self._steps += 1
        return self._observe(), reward, False, self._steps >= 16, {}


def make(name, hands=2, **policy_kwargs):
    kwargs = {"n_hands": hands, "net_arch": SMALL, **policy_kwargs}
    options = {"seed": 0, "device": "cpu", **OF_ALGORITHM[name]}
    return MODELS[name](POLICIES[name], Reach(hands), policy_kwargs=kwargs, **options)


def observations(count=30, hands=2):
    return np.random.default_rng(1).normal(size=(count, hands * N)).astype(np.float32)


def acted(model, seen=None):
    return model.predict(observations() if seen is None else seen, deterministic=True)[0]


def weights(seed=0):
    """Return weights with which actions are far from 0."""
    generator = torch.Generator().manual_seed(seed)
    return {
        name: torch.rand(tensor.shape, generator=generator) - 0.5
        for name, tensor in hand_weights(make("sac").policy).items()
    }


def test_one_hand_s_weights_play_both_hands_alike_in_all_algorithms():
    one = make("ppo", hands=1)
    load_hand_weights(one.policy, weights())
    apart = [acted(one, hand) for hand in np.split(observations(), 2, axis=1)]
    expected = np.concatenate(apart, axis=1)
    assert np.abs(expected).max() > 0.5
    for name in MODELS:
        both = make(name)
        assert np.abs(acted(both)).max() < 0.1  # small at first
        load_hand_weights(both.policy, hand_weights(one.policy))
        np.testing.assert_allclose(acted(both), expected, atol=1e-6)


@each
def test_it_learns_is_the_same_after_loading_and_learns_on(name, tmp_path):
    model = make(name)
    for part in [model.policy] if name == "ppo" else [model.actor, model.critic]:
        optimised = [p for group in part.optimizer.param_groups for p in group["params"]]
        assert {id(p) for p in optimised} == {id(p) for p in part.parameters()}
    before = hand_weights(model.policy)
    model.learn(12)  # of PPO its 32 steps
    for part, tensor in hand_weights(model.policy).items():
        assert torch.equal(tensor, before[part]) == part.startswith("standardize."), part
    set_standardization(model.policy, np.full(N, 0.3), np.full(N, 2.0))
    model.save(tmp_path / "model.zip")
    loaded = MODELS[name].load(tmp_path / "model.zip", env=Reach())
    np.testing.assert_array_equal(acted(loaded), acted(model))
    loaded.learn(12, reset_num_timesteps=False)
    assert np.abs(acted(loaded) - acted(model)).max() > 0
    model.policy.save(tmp_path / "policy.pt")
    alone = POLICIES[name].load(tmp_path / "policy.pt")
    np.testing.assert_array_equal(acted(alone), acted(model))


@each
def test_all_networks_see_standardised_observations(name):
    model = make(name)
    mean, std = np.linspace(-3, 3, N), np.linspace(0, 2, N)
    set_standardization(model.policy, mean, std)
    extractors = [part for part in model.policy.modules() if isinstance(part, Standardize)]
    assert len(extractors) == {"sac": 3, "td3": 4, "tqc": 3, "ppo": 1}[name]
    seen = 20 * observations()
    wanted = (seen.reshape(-1, 2, N) - mean) / np.where(std == 0, 1, std)
    assert np.abs(wanted).max() > CLIP
    wanted = np.clip(wanted, -CLIP, CLIP).reshape(seen.shape)
    for extractor in extractors:
        got = extractor(torch.as_tensor(seen)).numpy()
        np.testing.assert_allclose(got, wanted, rtol=1e-4, atol=1e-4)
    load_hand_weights(model.policy, {**weights(), **_standardization(model.policy)})
    plain = make(name)
    load_hand_weights(plain.policy, {**weights(), **_standardization(plain.policy)})
    expected = acted(plain, wanted.astype(np.float32))
    np.testing.assert_allclose(acted(model, seen), expected, atol=1e-4)


def _standardization(policy):
    return {k: v for k, v in hand_weights(policy).items() if k.startswith("standardize.")}


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_exploration_is_small_at_first_and_learnt(name):
    model = make(name, log_std_init=-3.0)
    torch.manual_seed(0)
    seen = np.repeat(observations(1), 4000, axis=0)
    spread = (model.predict(seen)[0] - acted(model, seen)).std(axis=0)
    np.testing.assert_allclose(spread, np.exp(-3.0), rtol=0.1)
    log_std = model.actor.log_std.values if name == "sac" else model.policy.log_std
    before = log_std.detach().clone()
    model.learn(12)
    assert not torch.equal(log_std, before)


@each
def test_critics_may_learn_faster_than_the_actor(name, tmp_path):
    scale = 50.0
    model = make(name, critic_lr_scale=scale)
    model.policy.save(tmp_path / "policy.pt")
    assert POLICIES[name].load(tmp_path / "policy.pt").critic_lr_scale == scale
    if name == "ppo":
        model.n_epochs = 1
    else:
        model.learning_starts, model.policy_delay = 30, 1
    before = {part: p.detach().clone() for part, p in model.policy.named_parameters()}
    model.learn(32 if name == "ppo" else 31)  # one update
    optimizer = (model.policy if name == "ppo" else model.critic).optimizer
    assert {group["lr"] for group in optimizer.param_groups} == {model.learning_rate}, "as before"
    moved = {part: _moved(p, before[part]) for part, p in model.policy.named_parameters()}
    # Adam's first step is about as long as the learning rate, whatever the gradient.
    for part, distance in moved.items():
        if "target" not in part:
            rate = model.learning_rate * (scale if "value_net" in part or "critic" in part else 1)
            assert 0.5 * rate < distance < 1.01 * rate, part


def _moved(now, before):
    return (now.detach() - before).abs().max().item()


def test_spaces_and_noise_that_do_not_fit_are_refused():
    for hands, message in ((5, "n_hands is 5, the observation space has 24"), (0, "n_hands is 0")):
        with pytest.raises(ConfigError, match=message):
            make("ppo", n_hands=hands)
    space, wide = Reach().observation_space, gym.spaces.Box(-2.0, 2.0, (2 * M,))
    with pytest.raises(ConfigError, match=r"from -2 to 2: expected -1 to 1\. Wrap"):
        HandsTD3Policy(space, wide, lambda _: 1e-3)
    with pytest.raises(ConfigError, match="use_sde is True: expected False"):
        SAC(HandsSACPolicy, Reach(), use_sde=True)


def test_weights_that_do_not_fit_are_refused_and_change_nothing():
    policy = make("td3").policy
    before = hand_weights(policy)
    with pytest.raises(ConfigError, match=r"only one of both has network\.hidden\.2\.linear"):
        load_hand_weights(policy, hand_weights(make("td3", net_arch=[16, 8, 8]).policy))
    with pytest.raises(
        ConfigError, match=r"head\.weight has the shape \(3, 20\): expected \(4, 20"
    ):
        load_hand_weights(policy, {**weights(), "head.weight": torch.ones(3, N + 8)})
    with pytest.raises(ConfigError, match=r"mean has the shape \(3,\)"):
        set_standardization(policy, np.zeros(3), np.ones(N))
    with pytest.raises(ConfigError, match="std has -1: expected no number below 0"):
        set_standardization(policy, np.zeros(N), -np.ones(N))
    assert all(torch.equal(hand_weights(policy)[name], before[name]) for name in before)
    other = TD3(RegularizedTD3Policy, Reach(), buffer_size=100).policy
    with pytest.raises(ConfigError, match="of the class RegularizedTD3Policy: expected HandsSAC"):
        hand_weights(other)


@pytest.mark.slow
def test_an_anchored_policy_stays_near_the_weights_that_it_was_given(tmp_path):
    away = {}
    for weight in (0.0, 3.0):
        model = make("ppo", anchored=True, log_std_init=-2.0)
        model.ent_coef, model.learning_rate = weight, 3e-3
        model._setup_lr_schedule()
        load_hand_weights(model.policy, weights())
        before = acted(model)
        model.learn(512)
        away[weight] = np.abs(acted(model) - before).mean()
    assert 0 < away[3.0] < 0.5 * away[0.0]
    model.save(tmp_path / "anchored")
    seen = torch.as_tensor(observations())
    loaded = PPO.load(tmp_path / "anchored", device="cpu")
    for one in (model, loaded):  # the anchor is saved, too
        acts = torch.as_tensor(before)
        assert one.policy.evaluate_actions(seen, acts)[2].mean() < 0
    np.testing.assert_allclose(
        *(one.policy.evaluate_actions(seen, acts)[2].detach() for one in (model, loaded)), rtol=1e-5
    )


@each
def test_the_actor_waits_until_the_critic_has_learnt(name):
    model = make(name, critic_first=10_000)
    before = acted(model)
    critic = model.policy.value_net if name == "ppo" else model.policy.critic
    start = torch.nn.utils.parameters_to_vector(critic.parameters()).clone()
    model.learn(12)
    np.testing.assert_array_equal(acted(model), before)
    assert not torch.equal(torch.nn.utils.parameters_to_vector(critic.parameters()), start)


@each
def test_actions_may_be_exactly_0_at_first(name, tmp_path):
    model = make(name, zero_start=True)
    assert (acted(model) == 0).all()
    model.learn(12)
    assert (acted(model) != 0).all()
    model.save(tmp_path / "model.zip")
    loaded = MODELS[name].load(tmp_path / "model.zip")
    assert loaded.policy.zero_start
    np.testing.assert_array_equal(acted(loaded), acted(model))
