"""What holds for each wrapper, and for stacks of them."""

from __future__ import annotations

import copy
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check

import sb3_piano.wrappers
from sb3_piano.envs import ObservationSpace
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import (
    Excerpt,
    FingeringDecay,
    HideFingering,
    KeyRange,
    KeyRewardTiering,
    Lookahead,
    OctaveShift,
    PitchShift,
    PreviousActionReward,
    RandomPiece,
    ResidualAction,
    RewardTiering,
    RewardWeights,
    TemporalStretch,
)

# Seven control steps, in the range of the three central octaves also three semitones higher.
PIECE = Score(
    notes=[
        Note(onset=0.0, offset=0.1, pitch=60, finger=0),
        Note(onset=0.1, offset=0.3, pitch=64, finger=2),
        Note(onset=0.1, offset=0.2, pitch=55, finger=7),
    ],
    title="piece",
    bars=[0.0, 0.1],
)
OTHER = Score(
    notes=[
        Note(onset=0.0, offset=0.15, pitch=62, finger=1),
        Note(onset=0.1, offset=0.2, pitch=67, finger=4),
    ],
    title="other",
)

# Each with the arguments that YAML would give it, and as random as it can be.
ARGUMENTS = {
    PitchShift: {"semitones": [-2, 3]},
    OctaveShift: {"octaves": [-1, 1]},
    TemporalStretch: {"factor": [0.5, 2]},
    RandomPiece: {"pieces": [PIECE, OTHER], "weights": [1, 2]},
    Excerpt: {"start": "random", "length": 0.1},
    KeyRange: {"keys": [36, 91]},
    Lookahead: {"steps": 4, "stride": 2, "fingers": True},
    HideFingering: {},
    PreviousActionReward: {},
    ResidualAction: {"scale": 0.2, "lookahead": 3, "settings": {"feedback": 0.4}},
    RewardWeights: {"weights": {"energy": 0, "key_press": 2}},
    FingeringDecay: {"n_steps": 10, "start": 3},
    KeyRewardTiering: {},
    RewardTiering: {"threshold": 0.4},
}


def single(wrapper):
    return lambda env: wrapper(env, **ARGUMENTS[wrapper])


def stacked(*wrappers):
    def stack(env):
        for wrapper in wrappers:
            env = single(wrapper)(env)
        return env

    return stack


# The first one innermost.
STACKS = {
    **{wrapper.__name__: single(wrapper) for wrapper in ARGUMENTS},
    "of the issue": lambda env: HideFingering(
        KeyRange(TemporalStretch(PitchShift(env, 3), 2.0), 36)
    ),
    "piece, keys, weights": stacked(RandomPiece, KeyRange, RewardWeights),
    "decay, excerpt, lookahead": stacked(FingeringDecay, Excerpt, Lookahead),
    "tiers, tiers, last reward": stacked(KeyRewardTiering, RewardTiering, PreviousActionReward),
    "last reward, octaves, tiers": stacked(PreviousActionReward, OctaveShift, KeyRewardTiering),
    "last reward, residual, hiding": stacked(PreviousActionReward, ResidualAction, HideFingering),
    "lookahead, hiding, keys": stacked(Lookahead, HideFingering, KeyRange),
    "keys, shift, simulated": lambda env: PitchShift(
        Lookahead(KeyRange(env, "piece", simulated=True), seconds=0.2), [-1, 1]
    ),
}


@pytest.fixture(params=STACKS)
def stack(request):
    """A function that puts a wrapper, or several, around an environment."""
    return STACKS[request.param]


@pytest.fixture
def env(stack):
    wrapped = stack(piano())
    yield wrapped
    wrapped.close()


def piano():
    return gym.make("RoboPianist-v0", score=PIECE, physics="fast", n_steps_lookahead=3)


def play(env, steps=30, seed=7):
    """Return observations and rewards of some steps, over several episodes."""
    random = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    observations, rewards = [observation], []
    for _ in range(steps):
        action = random.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        if terminated or truncated:
            observation, _ = env.reset()
            observations.append(observation)
    return np.array(observations), rewards


def assert_equal_playing(first, second, **options):
    (observations, rewards), (others, other_rewards) = (
        play(each, **options) for each in (first, second)
    )
    np.testing.assert_array_equal(observations, others)
    assert rewards == other_rewards


def test_no_wrapper_is_left_out():
    named = [getattr(sb3_piano.wrappers, name) for name in sb3_piano.wrappers.__all__]
    kinds = {kind for kind in named if isinstance(kind, type) and issubclass(kind, gym.Wrapper)}
    bases = {kind for kind in kinds if not issubclass(kind, gym.utils.RecordConstructorArgs)}
    assert set(ARGUMENTS) == kinds - bases


@pytest.mark.slow
def test_the_checks_of_gymnasium_and_of_sb3_pass_without_a_warning(env):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Gymnasium means this check for what is bare; that it is not is the point here.
        warnings.filterwarnings("ignore", ".*is different from the unwrapped version")
        if "previous_reward" in env.observation_space.layout:  # which has no bounds
            warnings.filterwarnings("ignore", r".*A Box observation space m\w+ value is -?infinity")
        gymnasium_check(env)
        sb3_check(env)


@pytest.mark.slow
def test_the_seed_decides_everything_in_one_environment_and_in_a_new_one(stack, env):
    first = play(env)
    env.unwrapped.total_steps = 0  # for schedules, which go on
    again, fresh = play(env), play(stack(piano()))
    for observations, rewards in (again, fresh):
        np.testing.assert_array_equal(observations, first[0])
        assert rewards == first[1]
    assert len(first[0]) > 32  # an episode has ended meanwhile


@pytest.mark.slow
@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_like_the_original(env, clone):
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(2):
        env.step(action)
    twin = clone(env)
    following, reward, *_ = env.step(action)
    twin_following, twin_reward, *_ = twin.step(action)
    np.testing.assert_array_equal(following, twin_following)
    assert reward == twin_reward
    assert twin.unwrapped is not env.unwrapped
    assert_equal_playing(env, twin)


@pytest.mark.slow
def test_the_spec_makes_the_same_stack_again(env):
    made = gym.make(env.spec)
    assert [type(layer) for layer in layers(made)] == [type(layer) for layer in layers(env)]
    assert made.observation_space == env.observation_space
    assert_equal_playing(env, made)


def layers(env):
    found = [env]
    while isinstance(found[-1], gym.Wrapper):
        found.append(found[-1].env)
    return found


@pytest.mark.slow
def test_observations_lie_in_the_space_and_have_memory_of_their_own(env):
    observation, _ = env.reset(seed=0)
    space = env.observation_space
    assert isinstance(space, ObservationSpace)
    assert space.shape == (space.layout.size,)
    for _ in range(3):
        before = observation.copy()
        following, *_ = env.step(env.action_space.sample())
        np.testing.assert_array_equal(observation, before)
        assert not np.shares_memory(observation, following)
        assert following.dtype == np.float32
        assert following in space
        observation = following


@pytest.mark.slow
def test_the_environment_inside_keeps_its_spaces(stack):
    inside = piano()
    space, low = inside.observation_space, inside.observation_space.low.copy()
    blocks = [(b.name, b.slice, b.shape) for b in inside.unwrapped.observation_layout.values()]
    actions = inside.action_space
    stack(inside).reset(seed=0)
    assert inside.observation_space is inside.unwrapped.observation_space is space
    assert inside.action_space is actions
    np.testing.assert_array_equal(space.low, low)
    after = [(b.name, b.slice, b.shape) for b in inside.unwrapped.observation_layout.values()]
    assert after == blocks


@pytest.mark.slow
def test_a_score_given_to_reset_arrives_and_is_played_once(env):
    given = Score(notes=[Note(onset=0.0, offset=0.3, pitch=66, finger=1)], title="given")
    env.reset(seed=0, options={"score": given})
    assert env.unwrapped.score.title == "given"
    assert len(env.unwrapped.score.notes) == 1
    env.reset()
    assert env.unwrapped.score.title != "given"


@pytest.mark.parametrize("wrapper", ARGUMENTS)
@pytest.mark.parametrize("env_id", ["CartPole-v1", "Pendulum-v1"])
def test_what_is_no_piano_is_refused(wrapper, env_id):
    with pytest.raises(ConfigError, match=rf"{wrapper.__name__} cannot wrap a \w+Env: expected a"):
        wrapper(gym.make(env_id), **ARGUMENTS[wrapper])
