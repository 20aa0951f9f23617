"""Batches of one environment each, in turn."""

import numpy as np
import pytest
import torch
from stable_baselines3.common.utils import set_random_seed
from transitions import ACTIONS, SPACE, Halves, Play

from sb3_piano.buffers import CompactReplayBuffer, CyclingReplayBuffer

N_ENVS = 3


@pytest.fixture
def buffer():
    """A buffer of three environments, full, whose rewards tell environment and row."""
    made, play = CyclingReplayBuffer(8 * N_ENVS, SPACE, ACTIONS, "cpu", N_ENVS), Play(n_envs=N_ENVS)
    for row in range(11):
        observations, new, actions, _, dones, infos = play.step()
        made.add(observations, new, actions, np.arange(N_ENVS) * 100.0 + row, dones, infos)
    return made


def test_batch_k_is_of_environment_k_modulo_their_number(buffer):
    assert buffer.full
    for k in range(2 * N_ENVS + 1):
        rewards = buffer.sample(60).rewards.numpy()
        assert set(np.unique(rewards // 100)) == {k % N_ENVS}
        assert set(np.unique(rewards % 100)) == set(range(3, 11))  # all rows that are left


def test_a_transition_is_the_one_that_was_added(buffer):
    for _ in range(N_ENVS):
        batch = buffer.sample(200)
        for item, reward in enumerate(batch.rewards.numpy().ravel()):
            env, row = int(reward // 100), int(reward % 100) % 8
            places = (np.array([row]), np.array([env]))
            expected = buffer.observations[places], buffer.next_observations[places]
            np.testing.assert_array_equal(batch.observations[item], expected[0][0])
            np.testing.assert_array_equal(batch.next_observations[item], expected[1][0])
            np.testing.assert_array_equal(batch.actions[item], buffer.actions[row, env])
            ended = buffer.dones[row, env] and not buffer.timeouts[row, env]
            assert bool(batch.dones[item]) == bool(ended)


def test_of_one_environment_batches_are_those_of_a_compact_buffer():
    kinds = (CyclingReplayBuffer, CompactReplayBuffer)
    pair, play = [kind(10, SPACE, ACTIONS, "cpu") for kind in kinds], Play()
    for _ in range(14):
        transition = play.step()
        for made in pair:
            made.add(*transition)
    samples = []
    for made in pair:
        set_random_seed(2)
        samples.append(made.sample(40))
    for ours, theirs in zip(*samples, strict=True):
        assert ours is theirs or torch.equal(ours, theirs)


def test_rewards_are_normalised_as_those_of_a_compact_buffer(buffer):
    """SB3 hands the normaliser of the environments to ``sample``."""

    batch = buffer.sample(50, env=Halves())
    assert set(np.unique(batch.rewards)) == {row / 2 for row in range(3, 11)}
    assert batch.observations.max() <= 0.5
    assert batch.next_observations.max() <= 0.5
