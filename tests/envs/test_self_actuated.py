"""The piano without hands, whose keys are driven."""

import math

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_checks_pass, steps_of
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.players import make_player
from sb3_piano.wrappers import (
    FingeringDecay,
    HandActions,
    HandReward,
    HideFingering,
    KeyRange,
    RewardTiering,
    RewardWeights,
)

ENV_ID = "RoboPianist-selfactuated-v0"
# The lowest and the highest key, and a black one that is struck again at once.
PIECE = score_of(
    (0.0, 0.2, 21), (0.0, 0.1, 61), (0.1, 0.2, 61), (0.2, 0.4, 108), pedals=[(0.1, 0.3)]
)


def without_hands(**options):
    return PianoEnv(PIECE, hands_in_scene="none", **options)


def as_goal(observation):
    """Return the action that plays what the observation asks for."""
    return np.where(observation[:89] > 0, 1.0, -1.0).astype(np.float32)


def play(env, policy):
    """Return rewards and the final info of an episode."""
    _, rewards, _, _, infos = zip(*steps_of(env, policy), strict=True)
    return list(rewards), infos[-1]


@pytest.mark.parametrize("lookahead", [0, 3])
def test_both_checks_pass(lookahead):
    env = gym.make(ENV_ID, n_steps_lookahead=lookahead)
    assert env.action_space.shape == (89,)
    assert env.observation_space.shape == ((lookahead + 1) * 89 + 89,)
    assert_checks_pass(env)


@pytest.mark.parametrize("physics", ["reference", "fast"])
@pytest.mark.parametrize("piece", [PIECE, "debug-TwinkleTwinkleLittleStar", "hanon-01"])
def test_who_plays_the_goal_plays_the_piece(piece, physics):
    rewards, info = play(gym.make(ENV_ID, score=piece, physics=physics), as_goal)
    for metric in ("f1", "onset_f1", "sustain_f1"):
        assert info[metric] == 1.0
    assert rewards == [0.0] * len(rewards)
    assert info["effective_fingers"] == 0


def test_who_does_nothing_pays_the_root_of_what_is_due():
    env = gym.make(ENV_ID, score=PIECE)
    rewards, info = play(env, lambda _: env.unwrapped.rest_action)
    due = env.unwrapped.roll.active.sum(axis=1) + env.unwrapped.roll.sustain
    assert rewards == pytest.approx([-math.sqrt(count) for count in due])
    assert info["return_distance"] == pytest.approx(sum(rewards))
    assert info["f1"] < 0.5


def test_the_other_reward_is_the_log_likelihood():
    weights = {"distance": 0.0, "log_likelihood": 1.0}
    env = gym.make(ENV_ID, score=PIECE, reward_weights=weights)
    epsilon = 1e-6

    def entropy(played, due):
        played, due = played.astype(float), due.astype(float)
        return np.sum(due * np.log(played + epsilon) + (1 - due) * np.log(1 - played + epsilon))

    random, piano = np.random.default_rng(0), env.unwrapped
    at_random = lambda _: random.choice([-1.0, 1.0], 89).astype(np.float32)  # noqa: E731
    for step, (_, reward, *_, info) in enumerate(steps_of(env, at_random)):
        played = np.append(piano.key_active, piano.pedal_down)
        due = np.append(piano.roll.active[step], piano.roll.sustain[step])
        assert reward == pytest.approx(entropy(played, due), abs=1e-3)
        assert info["reward_terms"]["distance"] == pytest.approx(-math.sqrt((played != due).sum()))


def test_an_action_between_sounds_from_some_angle_on():
    env = without_hands()
    for level, sounds in ((0.6, False), (1.0, True)):
        env.reset(seed=0)
        env.step(np.append(np.full(88, level), -1.0))
        assert env.key_active.all() == env.key_active.any() == sounds


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (HandActions, "HandActions finds no hands"),
        (HandReward, "HandReward finds no hands"),
        (HideFingering, "fingering"),
        (RewardTiering, "Unknown reward term 'energy'"),
        (lambda env: FingeringDecay(env, 10), "Unknown reward term 'fingering'"),
        (lambda env: RewardWeights(env, {"forearm": 1}), "Unknown reward term 'forearm'"),
        (lambda env: KeyRange(env, "piece", simulated=True), "driven themselves cannot be made"),
        (lambda env: make_player("planned", env), "without hands has nobody"),
        (lambda env: make_player("sight-reader", env), "without hands has nobody"),
    ],
)
def test_what_needs_hands_says_so(make, message):
    with pytest.raises(ConfigError, match=message):
        make(without_hands())


@pytest.mark.parametrize("hands", ["none", "right", "left"])
def test_it_is_drawn_with_the_hands_that_there_are(hands):
    env = PianoEnv("scale-CMajor", hands_in_scene=hands, render_mode="rgb_array")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert env.render().std() > 10
    env.close()
