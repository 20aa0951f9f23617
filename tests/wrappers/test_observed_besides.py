"""What is observed besides, or hidden: last action and reward, flag and finger labels."""

import dataclasses

import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction, TransformReward
from hypothesis import given, settings
from hypothesis import strategies as st
from side_by_side import TINY, block, episode

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Score
from sb3_piano.wrappers import (
    HideFingering,
    HindsightFlag,
    KeyRange,
    Lookahead,
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


def test_the_reward_is_the_one_of_the_environment_inside():
    hundredfold = lambda env: TransformReward(env, lambda reward: 100 * reward)  # noqa: E731
    inside, outside = PreviousActionReward(hundredfold(piano())), PreviousActionReward(piano())
    around = hundredfold(outside)
    for env, shown_share in ((inside, 1), (around, 100)):
        env.reset()
        shown, reward, *_ = env.step(env.unwrapped.rest_action)
        assert shown[-1] == np.float32(reward / shown_share)


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


@pytest.mark.parametrize(("low", "high"), [(-2, 1), (-1, 2), (-0.5, 0.5)])
def test_actions_of_another_range_are_refused(low, high):
    rescaled = RescaleAction(piano(), np.float32(low), np.float32(high))
    with pytest.raises(ConfigError, match=rf"actions of Box\({low:.1f}, {high:.1f}.*from -1 to 1"):
        PreviousActionReward(rescaled)


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
