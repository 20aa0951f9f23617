"""A buffer saved in segments comes back equal, wherever it was cut."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from transitions import SPACE, Play, assert_equal, make_pair, make_space
from yaml_rows import Tables

from sb3_piano.buffers import CompactNStepReplayBuffer, CompactReplayBuffer
from sb3_piano.callbacks.replay_segments import (
    ReplaySegments,
    end_last_episode,
    restore_replay_buffer,
)
from sb3_piano.exceptions import RunError

tables = Tables(__file__)


class LabelledBuffer(ReplayBuffer):
    """A buffer with one more array of rows, and one that has nothing to do with rows."""

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.labels = np.zeros((self.buffer_size, self.n_envs))
        self.table = np.zeros(3)

    def add(self, obs, *args, **kwargs):
        self.labels[self.pos] = obs[:, 0]
        super().add(obs, *args, **kwargs)


PAIRS = [(CompactReplayBuffer, ReplayBuffer), (CompactNStepReplayBuffer, NStepReplayBuffer)]
SAVED = [*PAIRS, *((kind, kind) for kind in (ReplayBuffer, NStepReplayBuffer, LabelledBuffer))]


def add_to_both(pair, play, count, segments):
    for _ in range(count):
        transition = play.step()
        for buffer in pair:
            buffer.add(*transition)
        segments.observe()


def save(segments):
    manifest = segments.write()
    segments.committed(manifest)
    return manifest


@pytest.mark.slow
@given(
    capacity=st.integers(2, 9),
    n_envs=st.integers(1, 3),
    layout=st.booleans(),
    kinds=st.sampled_from(SAVED),
    sittings=st.lists(st.lists(st.integers(0, 12), min_size=1, max_size=4), min_size=1, max_size=3),
    seed=st.integers(0, 2**32 - 1),
)
def test_after_any_checkpoints_and_resumptions_it_equals_a_stock_buffer_that_was_never_saved(
    capacity, n_envs, layout, kinds, sittings, seed
):
    """A sitting is a list of how many rows come before each of its checkpoints."""
    space = SPACE if layout else spaces.Box(0.0, 1.0, SPACE.shape, dtype=np.float32)
    play = Play(space, n_envs, seed)
    compact, stock = make_pair(capacity, n_envs, space, kinds=kinds)
    saved = None
    with tempfile.TemporaryDirectory() as folder:
        for additions in sittings:
            segments = ReplaySegments(Path(folder), compact, saved)
            for count in additions:
                add_to_both((compact, stock), play, count, segments)
                saved = save(segments)
            segments.write()  # killed before it is committed
            compact, _ = make_pair(capacity, n_envs, space, kinds=kinds)
            restore_replay_buffer(compact, Path(folder), saved)
            if stock.size():
                assert_equal(compact, stock)
            for buffer in (compact, stock):
                end_last_episode(buffer)
            play.reset()
    if stock.size():
        assert_equal(compact, stock)
    if isinstance(stock, LabelledBuffer):
        np.testing.assert_array_equal(compact.labels, stock.labels)


def test_rounded_last_observations_outlive_resuming(tmp_path):
    play, (compact, stock) = Play(), make_pair(4)
    segments = ReplaySegments(tmp_path, compact)
    for done in (True, False, True):
        observation, last, *rest = play.step([done])
        last = np.where(last == 1.0, 1.0 - 2**-24, last).astype(np.float32) if done else last
        for buffer in (compact, stock):
            buffer.add(observation, last, *rest)
    restored, _ = make_pair(4)
    restore_replay_buffer(restored, tmp_path, save(segments))
    assert_equal(restored, stock)


@tables("blocks, text")
def test_rows_of_another_observation_are_refused(tmp_path, blocks, text):
    play, (compact, _) = Play(), make_pair(6)
    segments = ReplaySegments(tmp_path, compact)
    compact.add(*play.step())
    saved = save(segments)
    other, _ = make_pair(6, space=make_space(*blocks))
    with pytest.raises(RunError, match=rf"replay-0-1.npz' does not fit a CompactR.*{text}"):
        restore_replay_buffer(other, tmp_path, saved)


@pytest.mark.parametrize("kinds", [PAIRS[0], PAIRS[0][::-1]], ids=["to stock", "to compact"])
def test_rows_of_the_other_kind_of_buffer_are_refused(tmp_path, kinds):
    source, target = make_pair(6, kinds=kinds)
    segments = ReplaySegments(tmp_path, source)
    source.add(*Play().step())
    saved = save(segments)
    with pytest.raises(RunError, match="is missing among.*kind of buffer changed since"):
        restore_replay_buffer(target, tmp_path, saved)
