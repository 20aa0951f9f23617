"""What holds for each wrapper, and for stacks of them."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_checks_pass, at_random, steps_of
from gymnasium.wrappers import RescaleObservation
from short_scores import score_of
from yaml_rows import Tables

import sb3_piano.wrappers
from sb3_piano.envs import ObservationSpace
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.lab.music import CorpusExcerpt
from sb3_piano.layers import layers
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import (
    Excerpt,
    FingeringDecay,
    HideFingering,
    HindsightFlag,
    KeyRange,
    KeyRewardTiering,
    Lookahead,
    OctaveShift,
    PitchShift,
    Pixels,
    PreviousActionReward,
    RandomPiece,
    RewardTiering,
    RewardWeights,
    TemporalStretch,
)

# Seven control steps, in the range of the three central octaves also three semitones higher.
PIECE = score_of(
    (0.0, 0.1, 60, 0), (0.1, 0.3, 64, 2), (0.1, 0.2, 55, 7), title="piece", bars=[0.0, 0.1]
)
OTHER = score_of((0.0, 0.15, 62, 1), (0.1, 0.2, 67, 4), title="other")

# Each with the arguments that YAML would give it, and as random as it can be.
tables = Tables(__file__)
ARGUMENTS = {
    getattr(sb3_piano.wrappers, name, CorpusExcerpt): arguments
    for name, arguments in tables["arguments"].items()
}
ARGUMENTS[RandomPiece]["pieces"] = [PIECE, OTHER]


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


def piano(**options):
    return gym.make("RoboPianist-v0", score=PIECE, physics="fast", n_steps_lookahead=3, **options)


def play(env, episodes=4, seed=7):
    """Return observations and rewards of several episodes."""
    observations, rewards = [], []
    for number in range(episodes):
        for observation, reward, *_ in steps_of(
            env, at_random(env, seed), seed=None if number else seed
        ):
            observations.append(observation)
            rewards.append(reward)
    return np.array(observations), rewards


def test_no_wrapper_is_left_out():
    named = [getattr(sb3_piano.wrappers, name) for name in sb3_piano.wrappers.__all__]
    kinds = {kind for kind in named if isinstance(kind, type) and issubclass(kind, gym.Wrapper)}
    bases = {kind for kind in kinds if not issubclass(kind, gym.utils.RecordConstructorArgs)}
    assert set(ARGUMENTS) == (kinds - bases) | {CorpusExcerpt}


@pytest.mark.slow
def test_the_checks_of_gymnasium_and_of_sb3_pass_without_a_warning(env):
    is_unbounded = "previous_reward" in getattr(env.observation_space, "layout", ())
    unbounded = r".*A Box observation space m\w+ value is -?infinity"
    assert_checks_pass(env, *([unbounded] if is_unbounded else []))


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_it_works_with_one_hand(stack, side):
    inside = piano(hands_in_scene=side)
    if side == "left" and stack in (STACKS["RandomPiece"], STACKS["piece, keys, weights"]):
        with pytest.raises(ScoreError, match="'other' has no notes for the left hand"):
            stack(inside)
        return
    wrapped = stack(inside)
    observations, rewards = play(wrapped, episodes=2)
    assert all(one in wrapped.observation_space for one in observations)
    assert np.isfinite(rewards).all()
    wrapped.close()


@pytest.mark.slow
def test_equal_seeds_play_alike_in_it_again_in_copies_and_in_what_the_spec_makes(stack, env):
    observations, rewards = play(env)
    made = gym.make(env.spec)
    assert [type(layer) for layer in layers(made)] == [type(layer) for layer in layers(env)]
    assert made.observation_space == env.observation_space
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(2):
        env.step(action)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    following, reward, *_ = env.step(action)
    for twin in copies:  # which go on from where it was
        assert twin.unwrapped is not env.unwrapped
        of_twin, its_reward, *_ = twin.step(action)
        np.testing.assert_array_equal(following, of_twin)
        assert reward == its_reward
    for other in (env, made, *copies):
        other.unwrapped.total_steps = 0  # for schedules, which go on
        of_other, its_rewards = play(other)
        np.testing.assert_array_equal(observations, of_other)
        assert rewards == its_rewards


@pytest.mark.slow
def test_observations_have_a_layout_and_memory_of_their_own(env):
    observation, _ = env.reset(seed=0)
    space = env.observation_space
    if not isinstance(env, Pixels):  # a picture has no layout
        assert isinstance(space, ObservationSpace)
        assert space.shape == (space.layout.size,)
    for _ in range(3):
        before = observation.copy()
        following, *_ = env.step(env.action_space.sample())
        np.testing.assert_array_equal(observation, before)
        assert not np.shares_memory(observation, following)
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
def test_what_is_no_piano_is_refused(wrapper):
    for env_id in ("CartPole-v1", "Pendulum-v1"):
        with pytest.raises(ConfigError, match=rf"{wrapper.__name__} cannot wrap a \w+Env: expect"):
            wrapper(gym.make(env_id), **ARGUMENTS[wrapper])


@tables("wrapper, changes, message")
def test_a_wrong_argument_is_refused_by_name_and_value(wrapper, changes, message):
    kind = getattr(sb3_piano.wrappers, wrapper)
    with pytest.raises((ConfigError, ScoreError, UnknownPieceError), match=message):
        kind(piano(), **{**ARGUMENTS[kind], **changes})


@pytest.mark.parametrize(
    ("inside", "wrapper", "message"),
    [
        (single(KeyRewardTiering), KeyRewardTiering, "KeyRewardTiering wraps another one"),
        (
            lambda env: RescaleObservation(env, np.float32(0), np.float32(1)),
            KeyRange,
            "KeyRange cannot read a Box without a layout",
        ),
        *(
            (single(kind), kind, f"Two blocks of the observation are called '{block}'")
            for kind, block in (
                (PreviousActionReward, "previous_action"),
                (HindsightFlag, "relabelled"),
                (Lookahead, "lookahead_fingering"),
            )
        ),
    ],
)
def test_a_wrapper_that_cannot_go_around_another_says_why(inside, wrapper, message):
    bounded = KeyRange(piano(), 88)
    with pytest.raises(ConfigError, match=message):
        wrapper(RewardWeights(inside(bounded), {}), **ARGUMENTS[wrapper])


@pytest.mark.parametrize("wrapper", [KeyRange, Lookahead, HideFingering])
def test_what_needs_keys_in_the_observation_says_so(wrapper):
    fingers = gym.make("RoboPianist-v0", score=PIECE, observation="fingers")
    with pytest.raises(ConfigError, match=r'targets.*expected .*"roll" or "window"'):
        wrapper(fingers, **ARGUMENTS[wrapper])
