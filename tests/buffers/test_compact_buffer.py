"""A compact buffer gives what SB3's own gives for the same transitions, and needs less for it."""

import copy
import pickle
import tracemalloc

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from transitions import ACTIONS, SPACE, Halves, Play, add, assert_equal, make_pair

from sb3_piano.buffers import (
    CompactDictReplayBuffer,
    CompactNStepReplayBuffer,
    CompactReplayBuffer,
    CyclingReplayBuffer,
)
from sb3_piano.exceptions import ConfigError

N_STEP = (CompactNStepReplayBuffer, NStepReplayBuffer)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(
    capacity=st.integers(1, 7),
    n_envs=st.integers(1, 3),
    layout=st.booleans(),
    normalizer=st.sampled_from([None, Halves()]),
    steps=st.lists(st.sampled_from(["go on", "end some", "end all", "start anew"]), max_size=30),
    seed=st.integers(0, 2**32 - 1),
)
def test_transitions_are_equal_for_any_pattern_of_episodes(
    capacity, n_envs, layout, normalizer, steps, seed
):
    space = SPACE if layout else spaces.Box(0.0, 1.0, SPACE.shape, dtype=np.float32)
    play, pair = Play(space, n_envs, seed), make_pair(capacity, n_envs, space)
    ends = {"go on": [False] * n_envs, "end all": [True] * n_envs}
    for step in steps:
        if step == "start anew":
            play.reset()
        add(pair, play.step(ends.get(step)))
        assert_equal(*pair, normalizer)


@pytest.mark.slow
@pytest.mark.parametrize("n_steps", [1, 3])
def test_n_step_returns_are_equal_too(n_steps):
    play = Play(n_envs=2)
    pair = [kind(40, SPACE, ACTIONS, "cpu", 2, n_steps=n_steps, gamma=0.9) for kind in N_STEP]
    for _ in range(50):
        add(pair, play.step())
        assert_equal(*pair)


def test_time_limits_are_handled_as_asked():
    kinds = (CompactReplayBuffer, ReplayBuffer)
    for handle in (True, False):
        pair = [kind(9, SPACE, ACTIONS, "cpu", handle_timeout_termination=handle) for kind in kinds]
        add(pair, (*Play().step([True])[:-1], [{"TimeLimit.truncated": True}]))
        assert_equal(*pair)
        assert pair[0].sample(1).dones.item() == (0.0 if handle else 1.0)


@pytest.mark.parametrize(
    ("observations", "actions"),
    [
        (spaces.Discrete(5), spaces.Discrete(3)),
        (spaces.MultiDiscrete([3, 4]), spaces.MultiDiscrete([2, 5])),
        (spaces.MultiBinary(9), spaces.MultiBinary(3)),
        (spaces.Box(0, 255, (3, 8, 8), np.uint8), spaces.Box(-1, 1, (2,), np.float64)),
        (spaces.Box(-1, 1, (4,), np.float64), spaces.Box(-1, 1, (2, 2), np.float32)),
    ],
    ids=str,
)
def test_other_spaces_are_held_as_in_the_stock_buffer(observations, actions):
    pair = make_pair(6, 2, observations, actions)

    def draw(space):
        return np.array([space.sample() for _ in range(2)])

    now = draw(observations)
    for number in range(16):
        new, ends = draw(observations), np.array([number % 3 == 0, False])
        for buffer in pair:
            buffer.add(now, new, draw(actions) * 0 + number % 2, np.ones(2), ends, [{}, {}])
        now = np.where(ends.reshape(2, *[1] * (new.ndim - 1)), draw(observations), new)
        assert_equal(*pair)


def test_after_a_reset_nothing_of_before_is_left():
    play, pair = Play(n_envs=2), make_pair(5, 2)
    for count in (7, 3):
        for buffer in pair:
            buffer.reset()
        for _ in range(count):
            add(pair, play.step())
    assert_equal(*pair)
    fresh, _ = make_pair(5, 2)
    pair[0].reset()
    assert pair[0].nbytes == fresh.nbytes


@pytest.mark.parametrize("rows", [1, 2, 3, 5, 12])
def test_a_transition_that_is_not_added_to_its_end_leaves_those_before_it_alone(rows):
    """As Ctrl-C may do, after which a notebook calls ``learn`` again."""
    play, pair = Play(n_envs=2), make_pair(5, 2)
    for _ in range(rows):
        add(pair, play.step([False, False]))
    half = list(play.step([False, False]))
    half[4] = np.zeros(7)  # the ends come after all else
    for buffer in pair:
        with pytest.raises(ValueError, match="broadcast"):
            buffer.add(*half)
    play.reset()
    add(pair, play.step())
    assert_equal(*pair)


@pytest.mark.parametrize("again", [copy.deepcopy, lambda b: pickle.loads(pickle.dumps(b))])
def test_a_copy_is_equal_and_goes_on_by_itself(again):
    play, pair = Play(n_envs=2), make_pair(5, 2)
    for _ in range(8):
        add(pair, play.step())
    twin = again(pair[0])
    assert_equal(twin, pair[1])
    before = copy.deepcopy(pair[1])
    for _ in range(3):
        transition = play.step()
        add((twin, pair[1]), transition)
    assert_equal(twin, pair[1])
    assert_equal(pair[0], before)


def test_a_million_transitions_of_the_full_observation_need_less_than_a_gigabyte_and_a_half():
    env = gym.make("RoboPianist-v0")
    observations, actions = env.observation_space, env.action_space
    assert observations.shape == (1124,)
    tracemalloc.start()
    buffer = CompactReplayBuffer(1_000_000, observations, actions, "cpu")
    _, peak = tracemalloc.get_traced_memory()  # numpy tells tracemalloc of its arrays
    tracemalloc.stop()
    row = 989 / 8 + 135 * 4 + 4 * (actions.shape[0] + 3)
    assert buffer.nbytes == pytest.approx(1_000_000 * row, rel=0.001)
    assert peak < buffer.nbytes + 1e6  # nor were stock's arrays there for a moment
    assert peak < 1.5e9


def test_a_binary_number_that_is_neither_0_nor_1_is_an_error_and_changes_nothing():
    play, pair = Play(n_envs=2), make_pair(4, 2)
    for _ in range(5):
        add(pair, play.step())
    bad = copy.deepcopy(play.step())
    bad[0][1, 5] = 0.75
    with pytest.raises(ConfigError, match=r"column 5 \(in block 'b1'\) of environment 1 is 0.75"):
        pair[0].add(*bad)
    assert_equal(*pair)


@pytest.mark.parametrize("kind", [CompactReplayBuffer, CompactNStepReplayBuffer])
def test_what_it_cannot_do_is_refused(kind):
    message = f"optimize_memory_usage is true for a {kind.__name__}: expected false"
    with pytest.raises(ConfigError, match=message):
        kind(10, SPACE, ACTIONS, "cpu", optimize_memory_usage=True)
    with pytest.raises(ConfigError, match="cannot hold observations of Dict.*CompactDict"):
        kind(10, spaces.Dict({"keys": SPACE}), ACTIONS, "cpu")


@pytest.mark.parametrize(
    "kind", [CompactReplayBuffer, CompactNStepReplayBuffer, CyclingReplayBuffer]
)
def test_transitions_of_other_environments_than_its_own_are_refused(kind):
    buffer = kind(8, SPACE, ACTIONS, n_envs=1)
    told = f"are of 2 environments, those of the {kind.__name__} of 1: expected"
    with pytest.raises(ConfigError, match=told):
        buffer.add(*Play(n_envs=2).step())
    wider = spaces.Box(0.0, 1.0, (16,))
    with pytest.raises(ConfigError, match="are of 16 numbers in an observation, those .* of 15"):
        buffer.add(*Play(wider).step())
    assert buffer.size() == 0
    buffer = CompactDictReplayBuffer(8, spaces.Dict({"seen": SPACE}), ACTIONS, n_envs=2)
    shown, following, *rest = Play().step()
    with pytest.raises(ConfigError, match="of 1 environments, those of the CompactDict.* of 2"):
        buffer.add({"seen": shown}, {"seen": following}, *rest)
