"""The flag of relabelled episodes as part of what is observed."""

from __future__ import annotations

import numpy as np
import pytest
from side_by_side import TINY, block, episode

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.wrappers import HindsightFlag, KeyRange


def piano():
    return PianoEnv(TINY, physics="fast")


def test_the_observation_is_followed_by_0_in_an_episode_that_is_played():
    env = HindsightFlag(piano())
    for expected, seen in episode(piano(), env):
        np.testing.assert_array_equal(seen[:-1], expected)
        assert seen[-1] == 0.0


def test_it_is_1_in_a_relabelled_one_also_inside_of_other_wrappers():
    flag = HindsightFlag(piano())
    env = KeyRange(flag, 88)
    flag.relabelled = True
    for (seen,) in episode(env):
        assert block(env, seen, "relabelled") == [1.0]


def test_the_block_is_binary_and_there_once():
    env = HindsightFlag(piano())
    assert env.observation_layout["relabelled"].binary
    with pytest.raises(ConfigError, match="Two blocks of the observation are called 'relabelled'"):
        HindsightFlag(env)
