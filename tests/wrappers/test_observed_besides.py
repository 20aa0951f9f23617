"""What is observed besides, or hidden: last action and reward, flag and finger labels."""

import dataclasses

import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction, TransformReward
from hypothesis import given, settings
from hypothesis import strategies as st
from short_scores import score_of
from side_by_side import TINY, block, episode

from sb3_piano.envs import KeyWindow, PianoEnv
from sb3_piano.exceptions import ConfigError, ScoreError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import (
    HideFingering,
    HindsightFlag,
    KeyRange,
    Lookahead,
    OctaveShift,
    PitchShift,
    PreviousActionReward,
)


def piano(**options):
    return PianoEnv(TINY, physics="fast", **options)


@pytest.mark.parametrize("options", [{}, {"reduced_action_space": False}])
def test_the_observation_is_followed_by_the_action_as_it_was_clipped_and_its_reward(options):
    bare, env = piano(**options), PreviousActionReward(piano(**options))
    size, actions = bare.observation_layout.size, bare.action_space.shape[0]
    assert env.observation_space.shape == (size + actions + 1,)
    rng = np.random.default_rng(0)
    for _ in range(2):  # an episode forgets the one before
        expected, _ = bare.reset()
        seen, _ = env.reset()
        action, reward, truncated = np.zeros(actions), 0.0, False
        while True:
            np.testing.assert_array_equal(seen[:size], expected)
            np.testing.assert_array_equal(seen[size:-1], np.clip(action, -1, 1).astype(np.float32))
            assert seen[-1] == np.float32(reward)
            assert env.observation_space.contains(seen)
            if truncated:
                break
            action = rng.uniform(-1.5, 1.5, actions)
            expected, *_ = bare.step(action)
            seen, reward, _, truncated, _ = env.step(action)
            assert reward != 0.0


def test_the_reward_is_the_one_of_the_environment_inside_and_actions_of_another_range_are_refused():
    hundredfold = lambda env: TransformReward(env, lambda reward: 100 * reward)  # noqa: E731
    inside, outside = PreviousActionReward(hundredfold(piano())), PreviousActionReward(piano())
    around = hundredfold(outside)
    for env, shown_share in ((inside, 1), (around, 100)):
        env.reset()
        shown, reward, *_ = env.step(env.unwrapped.rest_action)
        assert shown[-1] == np.float32(reward / shown_share)
    for low, high in ((-2, 1), (-1, 2), (-0.5, 0.5)):
        rescaled = RescaleAction(piano(), np.float32(low), np.float32(high))
        message = rf"actions of Box\({low:.1f}, {high:.1f}.*from -1 to 1"
        with pytest.raises(ConfigError, match=message):
            PreviousActionReward(rescaled)


def test_an_action_that_its_owner_changes_later_is_remembered_as_it_was():
    env = PreviousActionReward(piano())
    env.reset()
    action = np.full(39, 0.5, dtype=np.float32)
    seen, *_ = env.step(action)
    action[:] = -1.0
    assert (block(env, seen, "previous_action") == 0.5).all()
    assert (block(env, env.observation(seen[: -39 - 1]), "previous_action") == 0.5).all()
    again, *_ = env.step(action)
    assert (block(env, seen, "previous_action") == 0.5).all()
    assert (block(env, again, "previous_action") == -1.0).all()


# The flag of relabelled episodes as part of what is observed.


@pytest.mark.parametrize("relabelled", [False, True])
def test_the_observation_is_followed_by_whether_the_episode_is_relabelled(relabelled):
    flag = HindsightFlag(piano())
    env = KeyRange(flag, 88)
    flag.relabelled = relabelled
    for expected, seen in episode(piano(), env):
        np.testing.assert_array_equal(seen[:-1], expected)
        assert block(env, seen, "relabelled") == [relabelled]
    assert env.observation_layout["relabelled"].binary


# Finger labels out of sight: nothing of what is observed depends on them.


STACKS = {
    "alone": HideFingering,
    "around labels ahead": lambda env: HideFingering(Lookahead(env, 8, stride=2, fingers=True)),
    "inside of a lookahead": lambda env: Lookahead(HideFingering(env), 20),
    "between": lambda env: KeyRange(
        HideFingering(KeyRange(Lookahead(env, 4, fingers=True), 88)), 36, outside="hide"
    ),
}


def with_fingers(score, fingers):
    notes = [dataclasses.replace(n, finger=f) for n, f in zip(score.notes, fingers, strict=True)]
    return Score(notes=notes, pedals=score.pedals, title=score.title)


FINGERS = st.lists(st.integers(-1, 9), min_size=len(TINY.notes), max_size=len(TINY.notes))


@pytest.mark.slow
@pytest.mark.parametrize("stack", STACKS.values(), ids=STACKS)
@settings(max_examples=6, deadline=None)
@given(first=FINGERS, second=FINGERS, seed=st.integers(0))
def test_pieces_that_differ_in_their_labels_only_look_the_same(stack, first, second, seed):
    envs = [
        stack(PianoEnv(with_fingers(TINY, fingers), physics="fast", fingering_reward="off"))
        for fingers in (first, second)
    ]
    for one, other in episode(*envs, seed=seed):
        np.testing.assert_array_equal(one, other)


def test_the_labels_are_zeros_and_everything_else_is_there_in_its_place():
    shown_env, inner = (Lookahead(piano(), 4, fingers=True) for _ in range(2))
    env = HideFingering(inner)
    assert env.observation_space == inner.observation_space == shown_env.observation_space
    labels_were_shown = False
    for shown, hidden in episode(shown_env, env):
        for name in shown_env.observation_layout:
            seen, expected = block(env, hidden, name), block(shown_env, shown, name)
            if "fingering" in name:
                labels_were_shown |= expected.any()
                expected = np.zeros_like(expected)
            np.testing.assert_array_equal(seen, expected, name)
    assert labels_were_shown


def test_the_reward_still_tells_labels_unless_it_does_not_ask_for_them():
    def rewards(fingers, **options):
        env = PreviousActionReward(
            HideFingering(PianoEnv(with_fingers(TINY, fingers), physics="fast", **options))
        )
        env.reset(seed=0)
        action = env.unwrapped.rest_action
        return [block(env, env.step(action)[0], "previous_reward").item() for _ in range(8)]

    labels, others = [0, 6, -1, 0, 4], [3, 1, -1, 9, 2]
    assert rewards(labels) != rewards(others)
    for fingering_reward in ("off", "optimal-transport"):
        options = {"fingering_reward": fingering_reward}
        assert rewards(labels, **options) == rewards(others, **options)


# A part of the keyboard: what remains is what it was.


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


def test_a_piece_that_leaves_the_range_is_refused_and_the_next_one_is_played():
    with pytest.raises(ScoreError, match=r"C#6, D6, of pitch 85, 86, but.*48 to 83 \(C3 to B5\)"):
        KeyRange(PianoEnv("DMajorScaleTwoHands"), 36)
    with pytest.raises(ScoreError, match=r"Eb2, C6, C8, of pitch 39, 84, 108"):
        KeyRange(PianoEnv(TINY), 36)
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


# Farther ahead, or less far, than the environment by itself.


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


@pytest.mark.parametrize("stride", [1, 3])
def test_it_commutes_with_a_range_of_keys_and_of_two_the_outermost_decides(stride):
    cut_last = KeyRange(Lookahead(piano(), 6, stride=stride, fingers=True), 36, outside="hide")
    cut_first = Lookahead(KeyRange(piano(), 36, outside="hide"), 6, stride=stride, fingers=True)
    assert repr(cut_last.observation_layout) == repr(cut_first.observation_layout)
    once, twice = Lookahead(piano(), 2), Lookahead(Lookahead(piano(), 7, fingers=True), 2)
    labels = twice.observation_layout["lookahead_fingering"]
    assert labels.shape == (8, 10)
    for first, second, shown, other in episode(cut_last, cut_first, once, twice):
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(other[: labels.start], shown)


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


def test_a_time_is_a_number_of_steps_and_a_hundred_in_strides_of_ten_are_eleven_rows():
    for control_timestep, seconds, steps in [(0.05, 0.3, 6), (0.05, 5, 100), (0.1, 0.3, 3)]:
        env = Lookahead(PianoEnv(TINY, control_timestep=control_timestep), seconds=seconds)
        assert env.observation_layout["goal"].shape == (steps + 1, 89)
    env = Lookahead(PianoEnv("CMajorScaleTwoHands"), 100, stride=10, fingers=True)
    layout = env.observation_layout
    assert (layout["goal"].shape, layout["lookahead_fingering"].shape) == ((11, 89), (11, 10))
    assert list(layout)[-1] == "lookahead_fingering"
    assert "10 control steps" in layout["goal"].meaning
    assert "10 control steps" in layout["lookahead_fingering"].meaning
    assert "control steps." not in Lookahead(PianoEnv(TINY), 5).observation_layout["goal"].meaning


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
