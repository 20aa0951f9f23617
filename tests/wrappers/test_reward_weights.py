"""Rewards under other weights, and reward wrappers around each other."""

from __future__ import annotations

import itertools

import gymnasium as gym
import pytest
from episodes import at_random, steps_of
from gymnasium.wrappers import TimeLimit, TransformReward
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, RETURN_KEYS, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import FingeringDecay, KeyRewardTiering, RewardTiering, RewardWeights

tables = Tables(__file__)

TINY = score_of((0.0, 0.1, 60, 0), (0.15, 0.25, 64, 6), title="tiny")
STEPS = 6


def piano(**options):
    return PianoEnv(TINY, physics="fast", **options)


def episode(env, seed=0):
    """Return the rewards, terms and final info of an episode of random actions."""
    _, rewards, _, _, infos = zip(*steps_of(env, at_random(env, seed), seed=seed), strict=True)
    return list(rewards), [info["reward_terms"] for info in infos], infos[-1]


weights = st.dictionaries(
    st.sampled_from(sorted(DEFAULT_REWARD_WEIGHTS)), st.floats(-10, 10, allow_subnormal=False)
)
BARE = piano()


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(inner=weights, outer=weights, seed=st.integers(0, 2**32 - 1))
def test_rewards_are_those_of_an_environment_made_with_the_weights(inner, outer, seed):
    wrapped = RewardWeights(RewardWeights(BARE, inner), outer)
    made = piano(reward_weights={**inner, **outer})
    rewards, terms, _ = episode(wrapped, seed)
    expected, expected_terms, _ = episode(made, seed)
    assert rewards == expected
    assert terms == expected_terms


def test_the_environments_own_metrics_stay():
    own = episode(piano())[2]
    info = episode(RewardWeights(BARE, {"key_press": 0.0, "energy": 1.0}))[2]
    for name in (*RETURN_KEYS, "normalized_return", "f1"):
        assert info[name] == own[name]


# Reward wrappers around each other and others.

LAYERS = {
    "weights": lambda env: RewardWeights(env, {"fingering": 2.0, "energy": 0.5}),
    "decay": lambda env: FingeringDecay(env, STEPS, final=0.25),
    "keys": KeyRewardTiering,
    "comfort": lambda env: RewardTiering(env, 0.5),
    "other": lambda env: TimeLimit(env, 1000),
}


@pytest.mark.parametrize(
    "order", [*itertools.permutations(["weights", "decay", "keys", "comfort"])]
)
def test_in_every_order_the_reward_is_the_sum_of_the_final_terms_under_the_final_weights(order):
    env: gym.Env = piano()
    for name in (*order[:2], "other", *order[2:]):
        env = LAYERS[name](env)
    rewards, terms, _ = episode(env)
    for step, (reward, row) in enumerate(zip(rewards, terms, strict=True), start=1):
        first = 2.0 if order.index("weights") < order.index("decay") else 1.0
        fingering = first + (0.25 - first) * step / STEPS
        if order.index("weights") > order.index("decay"):
            fingering = 2.0
        final = {**DEFAULT_REWARD_WEIGHTS, "energy": 0.5, "fingering": fingering}
        assert reward == pytest.approx(sum(final[name] * value for name, value in row.items()))


@pytest.mark.parametrize("layer", ["weights", "decay", "keys", "comfort"])
def test_a_foreign_reward_inside_is_refused_and_outside_welcome(layer):
    def doubled(env):
        return TransformReward(env, lambda reward: 2.0 * reward)

    twice, once = episode(doubled(LAYERS[layer](piano())))[0], episode(LAYERS[layer](piano()))[0]
    assert twice == [2.0 * reward for reward in once]
    env = LAYERS[layer](doubled(piano()))
    env.reset(seed=0)
    with pytest.raises(ConfigError, match="a wrapper inside has changed it. Expected that wrapper"):
        env.step(env.unwrapped.rest_action)


# Four control steps with the last, silent one.
SHORT = Score(notes=[Note(onset=0.0, offset=0.15, pitch=60, finger=0)], title="short")


def short_piano(**options):
    return PianoEnv(SHORT, physics="fast", **options)


def weights_of(env, steps):
    """Return the weight of the fingering term that each control step's reward reveals."""
    found = []
    for _ in range(steps):
        _, reward, _, truncated, info = env.step(env.unwrapped.rest_action)
        terms = dict(info["reward_terms"])
        fingering = terms.pop("fingering")
        others = sum(DEFAULT_REWARD_WEIGHTS[name] * value for name, value in terms.items())
        found.append((reward - others) / fingering if fingering else None)
        if truncated:
            env.reset()
    return found


def approx(values):
    return [None if value is None else pytest.approx(value) for value in values]


def test_the_weight_falls_linearly_over_episodes_and_stays_and_two_decays_multiply():
    env = FingeringDecay(short_piano(), 5, start=2)
    env.reset(seed=0)
    # the fourth step of each episode has no finger label
    assert weights_of(env, 12) == approx([1, 1, 0.8, None, 0.4, 0.2, 0, None, 0, 0, 0, None])
    env = FingeringDecay(short_piano(), 10)
    env.unwrapped.total_steps = 6  # which were played before
    env.reset(seed=0)
    assert weights_of(env, 3) == approx([0.3, 0.2, 0.1])
    env = FingeringDecay(FingeringDecay(short_piano(), 4), 2)
    env.reset(seed=0)
    assert weights_of(env, 3) == approx([0.75 * 0.5, 0, 0])


@tables("inner, final, expected")
def test_it_starts_from_the_weight_inside_and_ends_at_the_final_one(inner, final, expected):
    made = FingeringDecay(short_piano(reward_weights={"fingering": inner}), 2, final=final)
    wrapped = FingeringDecay(RewardWeights(short_piano(), {"fingering": inner}), 2, final=final)
    for env in (made, wrapped):
        env.reset(seed=0)
        assert weights_of(env, 3) == approx(expected)
