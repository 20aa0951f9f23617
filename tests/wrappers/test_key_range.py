"""A part of the keyboard is observed: what remains is what it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from side_by_side import TINY, block, episode

from sb3_piano.envs import KeyWindow, PianoEnv
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import KeyRange, OctaveShift, PitchShift

UNCUT = ("fingering", "sustain", "right_joints", "left_joints")
MIDDLE = Score(notes=[Note(onset=0.0, offset=0.1, pitch=60, finger=0)], title="middle")


def middle():
    return PianoEnv(MIDDLE, physics="fast")


def assert_only_these_keys_are_seen(cut_env, cut, whole_env, whole, low, high):
    """Compare with the whole observation, by MIDI pitches."""
    keys = slice(low - 21, high - 20)
    expected = {name: block(whole_env, whole, name) for name in (*UNCUT, "goal", "key_state")}
    expected["goal"] = np.column_stack([expected["goal"][:, keys], expected["goal"][:, 88]])
    expected["key_state"] = expected["key_state"][keys]
    for name, values in expected.items():
        np.testing.assert_array_equal(block(cut_env, cut, name), values, name)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(ends=st.lists(st.integers(21, 108), min_size=2, max_size=2).map(sorted), seed=st.integers(0))
def test_the_observation_is_the_full_one_without_the_other_keys_at_every_step(ends, seed):
    whole_env = PianoEnv(TINY, physics="fast", n_steps_lookahead=3)
    inner = PianoEnv(TINY, physics="fast", n_steps_lookahead=3)
    env = KeyRange(inner, ends, outside="hide")
    for whole, cut in episode(whole_env, env, seed=seed):
        assert_only_these_keys_are_seen(env, cut, whole_env, whole, *ends)
    assert inner.observation_space == whole_env.observation_space


@pytest.mark.parametrize(
    ("keys", "low", "high"), [(12, 60, 71), (24, 48, 71), (36, 48, 83), (88, 21, 108)]
)
def test_a_number_of_keys_stands_for_the_central_octaves(keys, low, high):
    whole_env = middle()
    env = KeyRange(middle(), keys)
    assert env.observation_space.shape == (11 * (keys + 1) + 10 + keys + 1 + 46,)
    for whole, cut in episode(whole_env, env):
        assert_only_these_keys_are_seen(env, cut, whole_env, whole, low, high)


@pytest.mark.slow
def test_the_range_of_the_piece_is_the_window_of_the_environment():
    window_env = PianoEnv("CMajorScaleOneHand", observation="window", physics="fast")
    env = KeyRange(PianoEnv("CMajorScaleOneHand", physics="fast"), "piece")
    assert repr(env.observation_layout) == repr(window_env.observation_layout)
    assert env.observation_space == window_env.observation_space
    for window, cut in episode(window_env, env):
        np.testing.assert_array_equal(cut, window)


def test_the_range_of_the_piece_holds_all_that_score_wrappers_inside_may_make_of_it():
    env = KeyRange(OctaveShift(middle(), [-1, 1]), "piece", margin=1)
    assert env.window == KeyWindow(60 - 12 - 1 - 21, 60 + 12 + 1 - 21)
    played = set()
    for seed in range(12):
        observation, _ = env.reset(seed=seed)
        played |= set(np.flatnonzero(block(env, observation, "goal")[0]).tolist())
    assert played == {1, 13, 25}  # an octave down and one up, each a key from the end of the range


# What was cut before.


def test_ranges_can_be_nested_and_the_inner_one_decides_what_is_left_to_cut():
    once = KeyRange(middle(), 24)
    twice = KeyRange(KeyRange(middle(), 36), 24)
    assert repr(twice.observation_layout) == repr(once.observation_layout)
    for first, second in episode(once, twice):
        np.testing.assert_array_equal(first, second)
    columns = twice.observation_layout["goal"].columns
    assert columns.tolist() == [*range(27, 51), 88]
    with pytest.raises(ConfigError, match=r"pitch 48 to 83.*'goal'.*12 of them.*such as C5"):
        KeyRange(once, 36)


# Notes beyond the range.


def test_a_piece_that_leaves_the_range_is_refused_by_the_names_of_its_notes():
    with pytest.raises(ScoreError, match=r"C#6, D6, of pitch 85, 86, but.*48 to 83 \(C3 to B5\)"):
        KeyRange(PianoEnv("DMajorScaleTwoHands"), 36)
    with pytest.raises(ScoreError, match=r"Eb2, C6, C8, of pitch 39, 84, 108"):
        KeyRange(PianoEnv(TINY), 36)


def test_a_piece_given_to_reset_is_refused_too_and_the_next_one_is_played():
    env = KeyRange(middle(), 12)
    with pytest.raises(ScoreError, match=r"C5, of pitch 72, but.*or outside=\"hide\""):
        env.reset(options={"score": MIDDLE.transpose(12)})
    env.reset(options={"score": MIDDLE.transpose(11)})
    assert env.unwrapped.score == MIDDLE.transpose(11)
    with pytest.raises(ScoreError, match="B3, of pitch 59"):
        PitchShift(env, -1).reset()


# The simulated keys.


def test_with_simulated_keys_the_observation_space_is_the_same_and_only_these_keys_move():
    env = middle()
    seen_only = KeyRange(middle(), 24)
    simulated = KeyRange(env, 24, simulated=True)
    assert simulated.observation_space == seen_only.observation_space
    assert env.observation_space == PianoEnv(MIDDLE).observation_space
    assert env.scene.moving_keys == slice(48 - 21, 71 - 21 + 1)
    assert env.model.njnt == seen_only.unwrapped.model.njnt - 64
    for _ in episode(simulated):
        pass


def test_a_range_that_is_refused_leaves_the_simulation_as_it_was():
    env = PianoEnv(TINY)
    scene = env.scene
    with pytest.raises(ScoreError, match="C8"):
        KeyRange(env, 36, simulated=True)
    inner = KeyRange(env, [21, 100], outside="hide")
    with pytest.raises(ConfigError, match="such as"):
        KeyRange(inner, 88, simulated=True)
    assert env.scene is scene
