"""A replay buffer written in pieces: what each holds, and what does not fit.

That it is the same buffer when it is read back, `test_compact_checkpoints` proves of all kinds.
"""

import numpy as np
import pytest
from gymnasium import spaces
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from yaml_rows import Tables

from sb3_piano.callbacks.replay_segments import (
    ReplaySegments,
    end_last_episode,
    restore_replay_buffer,
)
from sb3_piano.exceptions import RunError

tables = Tables(__file__)

OBSERVATIONS = spaces.Box(-1.0, 1.0, (3,), dtype=np.float32)
ACTIONS = spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)
CAPACITY = 10  # rows; each has one transition per environment


def make_buffer(kind=ReplayBuffer, n_envs=1, capacity=CAPACITY, **kwargs):
    return kind(capacity * n_envs, OBSERVATIONS, ACTIONS, device="cpu", n_envs=n_envs, **kwargs)


def add_rows(buffer, count, rng):
    for _ in range(count):
        shape = (buffer.n_envs, 3)
        buffer.add(
            rng.uniform(-1, 1, shape).astype(np.float32),
            rng.uniform(-1, 1, shape).astype(np.float32),
            rng.uniform(-1, 1, (buffer.n_envs, 2)).astype(np.float32),
            rng.normal(size=buffer.n_envs),
            rng.random(buffer.n_envs) < 0.3,
            [{"TimeLimit.truncated": bool(rng.random() < 0.5)} for _ in range(buffer.n_envs)],
        )


def train_and_save(folder, buffer, additions, rng):
    """Add rows, with a committed write after each number of them; return the last manifest."""
    segments = ReplaySegments(folder, buffer)
    for count in additions:
        for _ in range(count):
            add_rows(buffer, 1, rng)
            segments.observe()
        manifest = segments.write()
        segments.committed(manifest)
    return manifest


@tables("additions, spans")
def test_each_write_holds_only_the_new_rows_that_are_still_there(tmp_path, additions, spans):
    manifest = train_and_save(tmp_path, make_buffer(), additions, np.random.default_rng(1))
    assert [[s.first, s.last] for s in manifest.segments] == spans
    for (first, last), segment in zip(spans, manifest.segments, strict=True):
        with np.load(tmp_path / segment.file) as rows:
            assert rows["observations"].shape == (last - first, 1, 3)


def test_ending_the_last_episode_keeps_its_transition_and_bounds_n_step_returns():
    buffer = make_buffer(NStepReplayBuffer, n_steps=3, gamma=1.0)
    end_last_episode(buffer)  # an empty one has none
    assert not buffer.dones.any()
    for reward, done in ((1.0, False), (10.0, False), (100.0, True)):
        zeros = np.zeros((1, 3), dtype=np.float32)
        buffer.add(zeros, zeros, np.zeros((1, 2)), np.array([reward]), np.array([done]), [{}])
        if reward != 1.0:
            end_last_episode(buffer)
    samples = buffer._get_samples(np.array([0, 1, 2]))
    assert samples.rewards.flatten().tolist() == [11.0, 10.0, 100.0]
    # the first two are truncated, so bootstrapped; a true end is left alone
    assert samples.dones.flatten().tolist() == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(("n_envs", "capacity"), [(2, CAPACITY), (1, CAPACITY + 1)])
def test_a_buffer_of_another_size_is_refused_and_both_sizes_are_told(tmp_path, n_envs, capacity):
    saved = train_and_save(tmp_path, make_buffer(), (4,), np.random.default_rng(1))
    text = rf"has 10 rows of 1 environment\(s\), the model's has {capacity} of {n_envs}"
    with pytest.raises(RunError, match=text):
        restore_replay_buffer(make_buffer(n_envs=n_envs, capacity=capacity), tmp_path, saved)


def _zeros_inside(content):
    """Overwrite the beginning of the first array's compressed data."""
    start = content.index(b".npy") + 4
    return content[: start + 20] + bytes(30) + content[start + 50 :]


def test_a_missing_or_damaged_segment_is_named(tmp_path):
    saved = train_and_save(tmp_path, make_buffer(), (4,), np.random.default_rng(1))
    path = tmp_path / "replay-0-4.npz"
    content = path.read_bytes()
    path.unlink()
    for left in (None, content[: len(content) // 2], b"", _zeros_inside(content)):
        if left is not None:
            path.write_bytes(left)
        with pytest.raises(RunError, match=r"Replay segment '.*replay-0-4\.npz' cannot be read"):
            restore_replay_buffer(make_buffer(), tmp_path, saved)
