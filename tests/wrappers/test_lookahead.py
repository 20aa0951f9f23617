"""Looking farther ahead, or less far, than the environment does by itself."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import score_of
from side_by_side import TINY, block, episode

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers import HideFingering, KeyRange, Lookahead


def piano(**options):
    return PianoEnv(TINY, physics="fast", **options)


OTHER = score_of((0.0, 0.1, 62, 2), (0.1, 0.3, 50, 7), title="other")


@pytest.mark.slow
@pytest.mark.parametrize("steps", [0, 1, 4, 10, 100])
@pytest.mark.parametrize("observation", ["roll", "window"])
def test_it_is_the_environment_that_looks_as_far_ahead_at_every_step(steps, observation):
    made_so = PianoEnv(TINY, n_steps_lookahead=steps, observation=observation, physics="fast")
    inner = PianoEnv(TINY, n_steps_lookahead=3, observation=observation, physics="fast")
    env = Lookahead(inner, steps)
    assert repr(env.observation_layout) == repr(made_so.observation_layout)
    assert env.observation_space == made_so.observation_space
    count = 0
    for expected, seen in episode(made_so, env):
        np.testing.assert_array_equal(seen, expected)
        count += 1
    assert count == 11  # ten steps, and what is seen after the last
    assert inner.observation_space.shape == inner.reset()[0].shape
    assert inner.observation_layout["goal"].shape[0] == 4


def test_a_time_is_a_number_of_steps():
    for control_timestep, seconds, steps in [(0.05, 0.3, 6), (0.05, 5, 100), (0.1, 0.3, 3)]:
        env = PianoEnv(TINY, control_timestep=control_timestep)
        layout = Lookahead(env, seconds=seconds).observation_layout
        assert layout["goal"].shape == (steps + 1, 89)


def due_by_hand(roll, step, rows, stride):
    """Return the goal's rows and those of the fingers, read off the roll note by note."""
    goal, fingers = np.zeros((rows, 89)), np.zeros((rows, 10))
    for row in range(rows):
        covered = (
            [step] if row == 0 else range(step + (row - 1) * stride + 1, step + row * stride + 1)
        )
        for later in covered:
            if later >= len(roll):
                continue
            goal[row, 88] = max(goal[row, 88], roll.sustain[later])
            for key in range(88):
                if roll.active[later, key]:
                    goal[row, key] = 1
                    if roll.finger[later, key] >= 0:
                        fingers[row, roll.finger[later, key]] = 1
    return goal, fingers


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(stride=st.integers(1, 12), strides=st.integers(0, 4))
def test_a_row_of_a_stride_has_what_is_due_in_any_of_its_steps(stride, strides):
    env = Lookahead(piano(), steps=stride * strides, stride=stride, fingers=True)
    for step, (observation,) in enumerate(episode(env)):
        shown = min(step, len(env.unwrapped.roll) - 1)
        goal, fingers = due_by_hand(env.unwrapped.roll, shown, strides + 1, stride)
        np.testing.assert_array_equal(block(env, observation, "goal"), goal)
        ahead = block(env, observation, "lookahead_fingering")
        np.testing.assert_array_equal(ahead, fingers)
        np.testing.assert_array_equal(ahead[0], block(env, observation, "fingering"))


def test_a_hundred_steps_in_strides_of_ten_are_eleven_rows_as_in_robovirtuoso():
    env = Lookahead(PianoEnv("CMajorScaleTwoHands"), 100, stride=10, fingers=True)
    layout = env.observation_layout
    assert (layout["goal"].shape, layout["lookahead_fingering"].shape) == ((11, 89), (11, 10))
    assert list(layout)[-1] == "lookahead_fingering"
    assert "10 control steps" in layout["goal"].meaning
    assert "10 control steps" in layout["lookahead_fingering"].meaning
    assert "control steps." not in Lookahead(PianoEnv(TINY), 5).observation_layout["goal"].meaning


@pytest.mark.parametrize("stride", [1, 3])
def test_it_commutes_with_a_range_of_keys(stride):
    cut_last = KeyRange(Lookahead(piano(), 6, stride=stride, fingers=True), 36, outside="hide")
    cut_first = Lookahead(KeyRange(piano(), 36, outside="hide"), 6, stride=stride, fingers=True)
    assert repr(cut_last.observation_layout) == repr(cut_first.observation_layout)
    for first, second in episode(cut_last, cut_first):
        np.testing.assert_array_equal(first, second)


def test_the_outermost_of_two_decides():
    once = Lookahead(piano(), 2)
    twice = Lookahead(Lookahead(piano(), 7, fingers=True), 2)
    labels = twice.observation_layout["lookahead_fingering"]
    assert labels.shape == (8, 10)
    for first, second in episode(once, twice):
        np.testing.assert_array_equal(second[: labels.start], first)


def test_each_episode_shows_its_own_piece():
    env = Lookahead(piano(), 6, stride=2, fingers=True)
    for options in (None, {"score": OTHER}, None):
        made_so = Lookahead(PianoEnv(OTHER if options else TINY, physics="fast"), 6, stride=2)
        size = made_so.observation_layout.size
        for expected, seen in episode(made_so, env, options=options):
            np.testing.assert_array_equal(seen[:size], expected)


def test_labels_that_are_hidden_inside_are_not_shown_again():
    hidden = KeyRange(HideFingering(PianoEnv(TINY)), 88)
    with pytest.raises(ConfigError, match="HideFingering outside, or fingers=False"):
        Lookahead(hidden, 10, fingers=True)
    assert "lookahead_fingering" not in Lookahead(hidden, 20).observation_layout
