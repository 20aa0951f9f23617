"""Corrections of a player: none plays as it does, others change what it does by so much."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction
from stable_baselines3.common.env_checker import check_env
from untrained_hand import hands, write_network

from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.music import Note, Score
from sb3_piano.players import HandModel, PlayerResidual, SightReader
from sb3_piano.players.planned import PlannedPianist
from sb3_piano.policies import HandsTD3Policy
from sb3_piano.wrappers import HandReward

TUNE = Score(notes=[Note(onset=i / 5, offset=(i + 1) / 5, pitch=72 + i, finger=i) for i in (0, 1)])
SHAPE = (44,)


class Played(gym.Wrapper):
    """Keep the actions that come in."""

    def step(self, action):
        self.__dict__.setdefault("actions", []).append(np.array(action))
        return self.env.step(action)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """Return the file of a network whose actions are anywhere in their range."""
    file = tmp_path_factory.mktemp("network") / "hand.safetensors"
    write_network(file, TUNE)
    return str(file)


def played(env, choose):
    """Return what an episode shows and how the hands move, and the observations' shape."""
    observation, _ = env.reset(seed=0)
    seen, over = [observation], False
    while not over:
        observation, _, terminated, truncated, _ = env.step(choose(observation))
        seen += [observation, env.unwrapped.data.qpos.copy()]
        over = terminated or truncated
    return seen


@pytest.mark.parametrize("observation", ["hands", "fingers"])
def test_an_action_of_0_plays_exactly_as_the_sight_reader(observation, network):
    alone, env = (hands(TUNE, observation), PlayerResidual(hands(TUNE, observation), model=network))
    reader = SightReader(alone, network)
    for ours, its in zip(
        played(env, lambda _: np.zeros(SHAPE)),
        played(alone, lambda seen: reader.predict(seen)[0]),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, its)


def test_it_standardises_what_the_network_does_not_know_as_loudness(network):
    one, two = (
        PlayerResidual(hands(TUNE, "hands", hands_version=version), model=network)
        for version in (1, 2)
    )
    pairs = zip(one.standardization, two.standardization, strict=True)
    for (before, after), added in zip(pairs, (0.5, 0.2), strict=True):
        assert 2 * len(after) == two.observation_space.shape[0]
        np.testing.assert_allclose(after, [*before, *[added] * 10], rtol=1e-6)


def test_an_action_of_0_plays_as_the_plan():
    alone, env = hands(TUNE).env, PlayerResidual(hands(TUNE), "planned")
    pianist = PlannedPianist(alone)
    for ours, its in zip(
        played(env, lambda _: np.zeros(SHAPE)),
        played(alone, lambda seen: pianist.predict(seen)[0]),
        strict=True,
    ):
        np.testing.assert_allclose(ours, its, atol=1e-3)
    assert env.unwrapped.performance.metrics()["f1"] > 0.8


def test_an_action_is_scaled_and_the_sum_is_cut(network):
    inside = Played(hands(TUNE))
    env = PlayerResidual(inside, scale=0.2, model=network)
    model = HandModel.load(network)
    correction = np.linspace(-2, 2, *SHAPE)
    read = []

    def choose(observation):
        read.append(model.act(observation))
        return correction

    played(env, choose)
    wanted = np.clip(np.array(read) + 0.2 * np.clip(correction, -1, 1), -1, 1)
    np.testing.assert_allclose(inside.actions, wanted, atol=1e-6)
    assert 0 < np.mean(np.abs(wanted) == 1) < 0.9


def test_it_is_an_environment_that_can_be_copied_and_made_again(network):
    env = PlayerResidual(hands(TUNE), model=network)
    check_env(env, skip_render_check=True)
    assert env.observation_space == hands(TUNE).observation_space
    assert env._saved_kwargs == {"player": "sight-reader", "scale": 0.05, "model": network}
    for made in (env, PlayerResidual(hands(TUNE), "planned")):
        first = played(made, lambda _: np.full(SHAPE, 0.5))
        for other in (copy.deepcopy(made), pickle.loads(pickle.dumps(made))):
            for one, same in zip(first, played(other, lambda _: np.full(SHAPE, 0.5)), strict=True):
                np.testing.assert_array_equal(one, same)


def test_what_does_not_fit_is_refused(network, tmp_path):
    env = PlayerResidual(hands(TUNE), model=network)
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match=r"shape \(45,\): expected \(44,\)"):
        env.step(np.zeros(45))
    with pytest.raises(ConfigError, match="scale is 0: expected"):
        PlayerResidual(hands(TUNE), scale=0, model=network)
    with pytest.raises(ConfigError, match="'sampled'"):
        PlayerResidual(hands(TUNE), "sampled")
    with pytest.raises(ConfigError, match="'planned' has no network: expected none"):
        PlayerResidual(hands(TUNE), "planned", model=network)
    with pytest.raises(ConfigError, match="cannot be read"):
        PlayerResidual(hands(TUNE), model=tmp_path / "none.safetensors")
    with pytest.raises(ConfigError, match="finds no HandActions around the piano"):
        PlayerResidual(hands(TUNE).env, model=network)
    with pytest.raises(ConfigError, match="cannot correct actions of"):
        PlayerResidual(RescaleAction(hands(TUNE), -2, 2), model=network)
    corrected = "finds PlayerResidual, whose actions are corrections"
    with pytest.raises(ConfigError, match=f"PlayerResidual {corrected}"):
        PlayerResidual(HandReward(env), model=network)
    with pytest.raises(ConfigError, match=f"The sight-reader {corrected}"):
        SightReader(env, network)
    policy = HandsTD3Policy(env.observation_space, env.action_space, lambda _: 1e-4)
    with pytest.raises(ConfigError, match=f"HandModel.of {corrected}"):
        HandModel.of(policy, env)
