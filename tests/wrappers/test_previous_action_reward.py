"""The last action and reward as part of what is observed."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction, TransformReward
from side_by_side import TINY, block

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers import HideFingering, PreviousActionReward


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
    inside = PreviousActionReward(TransformReward(piano(), lambda reward: 100 * reward))
    outside = TransformReward(PreviousActionReward(piano()), lambda reward: 100 * reward)
    action = inside.unwrapped.rest_action
    for env in (inside, outside):
        env.reset()
    shown_inside, reward_inside, *_ = inside.step(action)
    shown_outside, reward_outside, *_ = outside.step(action)
    assert reward_inside == reward_outside
    assert shown_inside[-1] == np.float32(reward_inside)
    assert shown_outside[-1] == np.float32(reward_outside / 100)


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


def test_it_can_be_there_only_once():
    with pytest.raises(ConfigError, match="Two blocks.*'previous_action'"):
        PreviousActionReward(HideFingering(PreviousActionReward(piano())))


@pytest.mark.parametrize(("low", "high"), [(-2, 1), (-1, 2), (-0.5, 0.5)])
def test_actions_of_another_range_are_refused(low, high):
    rescaled = RescaleAction(piano(), np.float32(low), np.float32(high))
    with pytest.raises(ConfigError, match=rf"actions of Box\({low:.1f}, {high:.1f}.*from -1 to 1"):
        PreviousActionReward(rescaled)
