"""What holds for each wrapper, and for stacks of them."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from episodes import assert_checks_pass, at_random, steps_of
from gymnasium.wrappers import RescaleObservation
from short_scores import score_of

import sb3_piano.wrappers
from sb3_piano.envs import ObservationSpace
from sb3_piano.exceptions import ConfigError, ScoreError, UnknownPieceError
from sb3_piano.lab.music import CorpusExcerpt
from sb3_piano.layers import layers
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import (
    Excerpt,
    FingeringDecay,
    HandActions,
    HandReward,
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
ARGUMENTS = {
    PitchShift: {"semitones": [-2, 3]},
    OctaveShift: {"octaves": [-1, 1]},
    TemporalStretch: {"factor": [0.5, 2]},
    RandomPiece: {"pieces": [PIECE, OTHER], "weights": [1, 2]},
    CorpusExcerpt: {"corpus": {"seed": 3, "n": 2, "duration": 0.5}},
    Excerpt: {"start": "random", "length": 0.1},
    KeyRange: {"keys": [36, 91]},
    Lookahead: {"steps": 4, "stride": 2, "fingers": True},
    HandActions: {"reach": 0.8},
    HandReward: {"own": 0.5, "within": 0.2, "strikes": 0.1},
    HideFingering: {},
    HindsightFlag: {},
    Pixels: {"width": 40, "height": 36, "camera": "topdown", "alone": True},
    PreviousActionReward: {},
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


def assert_equal_playing(first, second):
    (observations, rewards), (others, other_rewards) = play(first), play(second)
    np.testing.assert_array_equal(observations, others)
    assert rewards == other_rewards


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
def test_the_seed_decides_everything_in_one_environment_and_in_a_new_one(stack, env):
    assert_equal_playing(env, stack(piano()))
    env.unwrapped.total_steps = 0  # for schedules, which go on
    assert_equal_playing(env, stack(piano()))


@pytest.mark.slow
@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_goes_on_like_the_original(env, clone):
    env.reset(seed=1)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(2):
        env.step(action)
    twin = clone(env)
    assert twin.unwrapped is not env.unwrapped
    (following, reward, *_), (of_twin, its_reward, *_) = env.step(action), twin.step(action)
    np.testing.assert_array_equal(following, of_twin)
    assert reward == its_reward
    assert_equal_playing(env, twin)


@pytest.mark.slow
def test_the_spec_makes_the_same_stack_again(env):
    made = gym.make(env.spec)
    assert [type(layer) for layer in layers(made)] == [type(layer) for layer in layers(env)]
    assert made.observation_space == env.observation_space
    assert_equal_playing(env, made)


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


INF = float("inf")
REFUSED = [
    (PitchShift, {"semitones": "3b"}, "semitones is '3b': expected a whole number"),
    (PitchShift, {"semitones": [1, 2, 3]}, r"semitones is \[1, 2, 3\]: expected one number, or a"),
    (OctaveShift, {"octaves": [2, 1]}, r"octaves is \[2, 1\]: expected the lower end first"),
    (PitchShift, {"semitones": 1, "probability": 1.1}, "probability is 1.1: expected a finite"),
    (Pixels, {"width": 0}, "width is 0: expected a whole number from 1 to 1920 pixels"),
    (Pixels, {"camera": "side"}, "camera is 'side': expected one of 'overview', 'topdown'"),
    (TemporalStretch, {"factor": 2, "scale": "log"}, "scale is 'log': expected one of"),
    (TemporalStretch, {"factor": INF}, "factor is inf: expected a finite number above 0"),
    (TemporalStretch, {"factor": [0.0, 1]}, r"factor\[0\] is 0.0: expected a finite number"),
    (RandomPiece, {"pieces": []}, "pieces is .*: expected one or more"),
    (RandomPiece, {"pieces": 3}, "A piece cannot be given as int: expected a Score"),
    (RandomPiece, {"pieces": ["CMajorScaleOneHnd"]}, "Did you mean 'CMajorScaleOneHand'"),
    (RandomPiece, {"weights": [1]}, r"weights is \[1\]: expected a list of 2, one for each piece"),
    (RandomPiece, {"weights": [1, -0.1]}, "expected numbers from 0 on, not all of them 0"),
    (Excerpt, {"unit": "beats"}, "unit is 'beats': expected one of 'seconds', 'bars'"),
    (Excerpt, {"start": "anywhere"}, "start is 'anywhere': expected a number of seconds or 'ran"),
    (Excerpt, {"start": -1}, "start is -1: expected a finite number, 0 seconds or more"),
    (Excerpt, {"length": 0}, "length is 0: expected a finite number above 0 seconds"),
    (Excerpt, {"length": 1.5, "unit": "bars"}, "length is 1.5: expected a whole number above 0"),
    (Excerpt, {"start": 0.5, "length": 1, "unit": "bars"}, "start is 0.5: expected a whole number"),
    (KeyRange, {"keys": 48}, r"keys is 48: expected 12, 24, 36, 88, \"piece\""),
    (KeyRange, {"keys": [60, 48]}, r"keys is \[60, 48\]"),
    (KeyRange, {"keys": [20, 48]}, "from 21 to 108"),
    (KeyRange, {"margin": -1}, "margin is -1: expected a whole number, 0 or more"),
    (KeyRange, {"outside": "ignore"}, "outside is 'ignore': expected one of 'error', 'hide'"),
    (KeyRange, {"simulated": 1}, "simulated is 1: expected true or false"),
    (KeyRange, {"outside": "hide", "simulated": True}, "expected one of them only"),
    (Lookahead, {"steps": None}, "steps is None and seconds is None: expected exactly one"),
    (Lookahead, {"seconds": 0.5}, "steps is 4 and seconds is 0.5: expected exactly one"),
    (Lookahead, {"steps": -1}, "steps is -1: expected a whole number from 0 to 10000 control"),
    (Lookahead, {"steps": None, "seconds": 0.52}, r"0.52.*0.05 s: expected 0.5 or 0.55"),
    (Lookahead, {"steps": None, "seconds": 0.5 + 1e-8}, "expected 0.5 or 0.55"),
    (Lookahead, {"steps": None, "seconds": -0.5}, "expected a finite number, 0 s or more"),
    (Lookahead, {"stride": 0}, "stride is 0: expected a whole number, 1 or more"),
    (Lookahead, {"steps": 10, "stride": 4}, "stride 4: expected a multiple of it, such as 8 or 12"),
    (Lookahead, {"fingers": "yes"}, "fingers is 'yes': expected true or false"),
    (RewardWeights, {"weights": {"fingring": 1}}, "term 'fingring'. Did you mean 'fingering'"),
    (RewardWeights, {"weights": {"energy": "x"}}, r"weights\['energy'\] is 'x': expected a"),
    (RewardWeights, {"weights": {"energy": 1e308}}, r"finite number from -1e\+06 to 1e\+06"),
    (FingeringDecay, {"n_steps": 0}, "n_steps is 0: expected a whole number, 1 or more"),
    (FingeringDecay, {"start": -1}, "start is -1: expected a whole number, 0 or more"),
    (FingeringDecay, {"final": INF}, "final is inf: expected a finite number"),
    (RewardTiering, {"threshold": 1.01}, "threshold is 1.01: expected a finite number from 0 to 1"),
]


@pytest.mark.parametrize(("wrapper", "changes", "message"), REFUSED)
def test_a_wrong_argument_is_refused_by_name_and_value(wrapper, changes, message):
    with pytest.raises((ConfigError, ScoreError, UnknownPieceError), match=message):
        wrapper(piano(), **{**ARGUMENTS[wrapper], **changes})


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
