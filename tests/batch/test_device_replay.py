"""The replay buffer on the device gives what SB3's own gives."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_piano.batch import DeviceReplayBuffer
from sb3_piano.buffers.rows import buffer_rows

SPACES = (spaces.Box(-8, 8, (3,)), spaces.Box(-2, 2, (1,)))  # those of a pendulum


def filled(made, steps=7, n_envs=3):
    """Return a buffer of four rows, which has gone round."""
    rng = np.random.default_rng(0)
    buffer = made(4 * n_envs, *SPACES, device="cpu", n_envs=n_envs)
    for _ in range(steps):
        one, other = rng.normal(size=(2, n_envs, 3)).astype(np.float32)
        action, reward = rng.uniform(-1, 1, (n_envs, 1)), rng.normal(size=n_envs)
        done = rng.random(n_envs) < 0.5
        infos = [{"TimeLimit.truncated": bool(rng.random() < 0.5)} for _ in done]
        buffer.add(one, other, action, reward, done, infos)
    return buffer


def transitions(buffer, env=None):
    """Return all that the buffer gives, as a set of tuples of numbers."""
    samples = buffer.sample(400, env)[:5]
    rows = np.concatenate([part.numpy().reshape(400, -1) for part in samples], axis=1)
    return {tuple(row) for row in np.round(rows, 4).tolist()}


def test_samples_are_those_of_the_usual_buffer():
    ours, theirs = filled(DeviceReplayBuffer), filled(ReplayBuffer)
    assert transitions(ours) == transitions(theirs)
    assert len(transitions(ours)) == 12


def test_samples_are_normalised_as_usual():
    venv = VecNormalize(DummyVecEnv([lambda: gym.make("Pendulum-v1")] * 3))
    venv.reset()
    for _ in range(5):
        venv.step(np.ones((3, 1)))
    ours, theirs = (transitions(filled(made), venv) for made in (DeviceReplayBuffer, ReplayBuffer))
    assert len(ours) == len(theirs) == 12
    np.testing.assert_allclose(sorted(ours), sorted(theirs), atol=2e-4)
    assert ours != transitions(filled(DeviceReplayBuffer))


def test_rows_are_saved_and_put_back():
    old = filled(DeviceReplayBuffer)
    new = DeviceReplayBuffer(12, *SPACES, device="cpu", n_envs=3)
    rows = np.arange(4)
    buffer_rows(new).put_rows(rows, buffer_rows(old).take_rows(rows))
    new.pos, new.full = old.pos, old.full
    assert transitions(new) == transitions(old)


def test_what_it_has_not_is_refused():
    with pytest.raises(ValueError, match="no optimize_memory_usage"):
        DeviceReplayBuffer(12, *SPACES, optimize_memory_usage=True)
