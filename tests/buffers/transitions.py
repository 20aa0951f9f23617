"""Transitions for the tests of replay buffers, and how to compare a compact one with SB3's own."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.utils import set_random_seed

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.envs import ObservationBlock, ObservationLayout, ObservationSpace

ACTIONS = spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)


def make_space(*blocks: tuple[int, bool]) -> ObservationSpace:
    """Return a space of blocks given as (size, binary)."""
    return ObservationSpace(
        ObservationLayout(
            ObservationBlock(name=f"b{i}", shape=(size,), unit="1", meaning="", binary=binary)
            for i, (size, binary) in enumerate(blocks)
        )
    )


SPACE = make_space((2, False), (9, True), (1, False), (3, True))


class Play:
    """Random episodes of some environments, as SB3 would hand them to ``ReplayBuffer.add``."""

    def __init__(self, space=SPACE, n_envs=1, seed=0):
        self.space, self.n_envs = space, n_envs
        self.rng = np.random.default_rng(seed)
        self.reset()

    def _observations(self):
        low = np.zeros((self.n_envs, *self.space.shape))
        observations = self.rng.uniform(low, 1).astype(self.space.dtype)
        for block in getattr(self.space, "layout", {}).values():
            if block.binary:
                observations[:, block.slice] = observations[:, block.slice] < 0.3
        return observations

    def reset(self):
        """Begin new episodes without ending the old ones, as calling ``learn`` again does."""
        self.observations = self._observations()

    def step(self, dones=None):
        """Return the arguments of ``add`` for one more step; draw ends where none are given."""
        done = self.rng.random(self.n_envs) < 0.3 if dones is None else np.array(dones)
        observations, new = self.observations, self._observations()
        self.observations = np.where(done[:, None], self._observations(), new)
        return (
            observations,
            new,
            self.rng.uniform(-1, 1, (self.n_envs, 2)).astype(np.float32),
            self.rng.normal(size=self.n_envs),
            done,
            [{"TimeLimit.truncated": bool(d and self.rng.random() < 0.5)} for d in done],
        )


class Halves:
    """What SB3 hands to ``sample`` to normalise by."""

    def normalize_obs(self, observations):
        return observations / 2

    def normalize_reward(self, rewards):
        return rewards / 2


def make_pair(
    capacity, n_envs=1, space=SPACE, actions=ACTIONS, kinds=(CompactReplayBuffer, ReplayBuffer)
):
    """Return a compact buffer and one of SB3, of as many rows."""
    return tuple(kind(capacity * n_envs, space, actions, "cpu", n_envs) for kind in kinds)


def add(buffers, transition):
    """Add a transition to each buffer."""
    for buffer in buffers:
        buffer.add(*transition)


def assert_equal(compact, stock, env=None):
    """Assert that all rows, and samples drawn with one seed, are equal to the last bit."""
    assert (compact.pos, compact.full) == (stock.pos, stock.full)
    rows, envs = (places.ravel() for places in np.indices((stock.size(), stock.n_envs)))
    for name in ("observations", "next_observations"):
        theirs, ours = (getattr(buffer, name)[rows, envs] for buffer in (stock, compact))
        assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
        assert ours.tobytes() == theirs.tobytes(), name
    assert_equal_samples(compact, stock, env)


def assert_equal_samples(compact, stock, env=None):
    set_random_seed(7)  # SB3 draws with numpy's global generator
    theirs = stock.sample(50, env)
    set_random_seed(7)
    ours = compact.sample(50, env)
    for name, a, b in zip(theirs._fields, ours, theirs, strict=True):
        if b is not None or a is not None:
            assert (a.shape, a.dtype) == (b.shape, b.dtype), name
            assert a.numpy().tobytes() == b.numpy().tobytes(), name
