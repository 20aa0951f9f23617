"""A checkpoint is complete, valid at every moment, and taken at the right step."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from acting import ActAt
from gymnasium import spaces
from scripted import tiny
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import NStepReplayBuffer, ReplayBuffer
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, EveryNTimesteps
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import VecNormalize
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint, ResumableCheckpoint
from sb3_piano.callbacks.replay_segments import (
    ReplaySegments,
    end_last_episode,
    restore_replay_buffer,
)
from sb3_piano.exceptions import ConfigError, RunError


def make_model(n_envs=1, normalize=False, **kwargs):
    venv = make_vec_env("Pendulum-v1", n_envs=n_envs, seed=0)
    settings = {"buffer_size": 60 * n_envs, "batch_size": 256, "seed": 0, **kwargs}
    return tiny(VecNormalize(venv) if normalize else venv, SAC, **settings)


class SavedSteps(BaseCallback):
    """Note down at which steps the checkpoint changes, and what it then holds."""

    def __init__(self, folder):
        super().__init__()
        self.folder = folder
        self.steps = []
        self.rows = []

    def _on_rollout_start(self):
        saved = Checkpoint.read(self.folder)
        if saved is not None and saved.num_timesteps not in self.steps:
            self.steps.append(saved.num_timesteps)
            self.rows.append(saved.replay.total)

    def _on_step(self):
        return True


class Killed(BaseException):
    """Stands for SIGKILL: nothing catches it."""


@pytest.mark.parametrize(("n_envs", "steps"), [(1, [20, 40]), (3, [21, 42])])
def test_steps_are_counted_not_calls_and_each_counted_step_is_in_the_buffer(
    tmp_path, n_envs, steps
):
    watcher = SavedSteps(tmp_path)
    make_model(n_envs).learn(50, callback=[ResumableCheckpoint(tmp_path, 20), watcher])
    assert watcher.steps == steps
    assert watcher.rows == [count // n_envs for count in steps]


def test_the_end_of_training_is_saved_with_its_labels_and_only_once(tmp_path):
    assert Checkpoint.read(tmp_path) is None
    saver = ResumableCheckpoint(tmp_path, 20, labels={"algo": "sac"})
    make_model().learn(25, callback=saver)
    saved = Checkpoint.read(tmp_path)
    assert (saved.num_timesteps, saved.labels) == (25, {"algo": "sac"})
    written = (tmp_path / "checkpoint.json").stat().st_mtime_ns
    saver.save()
    assert (tmp_path / "checkpoint.json").stat().st_mtime_ns == written
    # Of files that are in the way, only those of former checkpoints go.
    for name in ("notes.txt", "model-7.zip.partial"):
        (tmp_path / name).touch()
    make_model().learn(100, callback=ResumableCheckpoint(tmp_path, 20))
    segments = {f"replay-{end - 20}-{end}.npz" for end in (60, 80, 100)}  # the buffer holds 60 rows
    expected = {"checkpoint.json", "model-100.zip", "notes.txt", *segments}
    assert {path.name for path in tmp_path.iterdir()} == expected


def test_statistics_of_vec_normalize_and_a_copy_of_the_model_are_kept(tmp_path):
    model = make_model(normalize=True)
    saver = ResumableCheckpoint(tmp_path / "inner", 20, model_copy=tmp_path / "model.zip")
    model.learn(50, callback=saver)
    assert SAC.load(tmp_path / "model.zip").num_timesteps == 50
    saved = Checkpoint.read(tmp_path / "inner")
    for path in (tmp_path / "inner" / saved.vec_normalize, tmp_path / "vecnormalize.pkl"):
        loaded = VecNormalize.load(str(path), make_vec_env("Pendulum-v1"))
        np.testing.assert_array_equal(loaded.obs_rms.mean, model.get_env().obs_rms.mean)


@pytest.mark.slow
@pytest.mark.parametrize("kill_at", range(1, 8))
def test_a_process_killed_at_any_file_leaves_a_checkpoint_that_can_be_restored(
    tmp_path, monkeypatch, kill_at
):
    """Three files are renamed per checkpoint; die before or after each of the first ones."""
    real, calls = os.replace, []

    def replace(source, target):
        calls.append(target)
        if len(calls) == kill_at:
            raise Killed
        real(source, target)

    model = make_model(learning_starts=30)
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replace)
        with pytest.raises(Killed):
            model.learn(200, callback=ResumableCheckpoint(tmp_path, 20))
    saved = Checkpoint.read(tmp_path)
    committed = (kill_at - 1) // 3
    assert (0 if saved is None else saved.num_timesteps) == 20 * committed
    if saved is not None:
        other = make_model()
        restore_replay_buffer(other.replay_buffer, tmp_path, saved.replay)
        assert SAC.load(tmp_path / saved.model).num_timesteps == 20 * committed
        assert other.replay_buffer.size() == min(20 * committed, 60)


def test_a_killed_deletion_leaves_a_checkpoint_that_can_be_restored(tmp_path, monkeypatch):
    whole = Path.unlink

    def unlink(self, missing_ok=False):
        if self.suffix != ".partial":  # which every writer cleans
            raise Killed
        whole(self, missing_ok)

    with monkeypatch.context() as patch:
        patch.setattr("pathlib.Path.unlink", unlink)
        with pytest.raises(Killed):
            make_model().learn(200, callback=ResumableCheckpoint(tmp_path, 20))
    assert Checkpoint.read(tmp_path).num_timesteps == 40
    make_model().learn(25, callback=ResumableCheckpoint(tmp_path, 20))
    assert not (tmp_path / "model-20.zip").exists()


class Counter(BaseCallback):
    """Count calls, on from where it stopped."""

    def __init__(self, by=1):
        super().__init__()
        self.by = by
        self.count = 0

    def state_dict(self):
        return {"count": self.count}

    def load_state_dict(self, state):
        if state["count"] < 0:
            raise ConfigError("count is below 0: expected more.")
        self.count = state["count"]

    def _on_step(self):
        self.count += self.by
        return True


class OtherCounter(Counter):
    """A class with states of its own."""


def counters():
    """Return callbacks of two classes, some of them inside others, and the list to train with."""
    found = [Counter(1), OtherCounter(100), Counter(10), Counter(1000)]
    first, other, second, third = found
    nested = CallbackList([EveryNTimesteps(5, second), third])
    return found, [first, other, nested]


def test_the_states_of_callbacks_at_the_checkpoints_step_are_saved_and_each_gets_its_own(tmp_path):
    found, every = counters()
    checkpoint = ResumableCheckpoint(tmp_path, 20, callbacks=every)
    model = make_model()
    with pytest.raises(KeyboardInterrupt):
        model.learn(25, callback=[*every, checkpoint, ActAt(23, "keyboard")])
    assert found[0].count == 23
    saved = Checkpoint.read(tmp_path)
    assert saved.num_timesteps == 20
    others, every = counters()
    saved.restore_callbacks(every)
    assert [callback.count for callback in others] == [20, 2000, 40, 20_000]


@pytest.mark.parametrize("has_states", [True, False], ids=["", "of before there were states"])
def test_callbacks_that_were_not_there_begin_anew_and_states_of_others_are_left(
    tmp_path, has_states
):
    first = Counter()
    make_model().learn(5, callback=[first, ResumableCheckpoint(tmp_path, callbacks=[first])])
    content = json.loads((tmp_path / "checkpoint.json").read_text())
    if not has_states:
        del content["callbacks"]
        (tmp_path / "checkpoint.json").write_text(json.dumps(content))
    again = [OtherCounter(), Counter(), Counter()]
    Checkpoint.read(tmp_path).restore_callbacks(again)
    assert [callback.count for callback in again] == [0, 5 * has_states, 0]
    Checkpoint.read(tmp_path).restore_callbacks([])


def test_a_state_that_its_callback_refuses_is_named(tmp_path):
    first = Counter(by=-1)
    make_model().learn(5, callback=[first, ResumableCheckpoint(tmp_path, callbacks=[first])])
    message = r"checkpoint.json has a state of test_checkpoint.Counter that is unusable: count is"
    with pytest.raises(RunError, match=message):
        Checkpoint.read(tmp_path).restore_callbacks([Counter()])


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"replay": null, "colour": 1}', "{"])
def test_a_damaged_checkpoint_file_or_one_that_is_missing_is_named(tmp_path, content):
    (tmp_path / "checkpoint.json").write_text(content)
    with pytest.raises(RunError, match=r"'.*checkpoint\.json' cannot be read"):
        Checkpoint.read(tmp_path)
    (tmp_path / "checkpoint.json").write_text('{"num_timesteps": 5, "model": "model-5.zip"}')
    with pytest.raises(RunError, match=r"names 'model-5\.zip', which is not there: expected all 1"):
        Checkpoint.read(tmp_path)


# The segments of a replay buffer.


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


def _zeros_inside(content):
    """Overwrite the beginning of the first array's compressed data."""
    start = content.index(b".npy") + 4
    return content[: start + 20] + bytes(30) + content[start + 50 :]


def test_a_missing_damaged_or_other_segment_is_named(tmp_path):
    saved = train_and_save(tmp_path, make_buffer(), (4,), np.random.default_rng(1))
    path = tmp_path / "replay-0-4.npz"
    content = path.read_bytes()
    path.unlink()
    for left in (None, content[: len(content) // 2], b"", _zeros_inside(content)):
        if left is not None:
            path.write_bytes(left)
        with pytest.raises(RunError, match=r"Replay segment '.*replay-0-4\.npz' cannot be read"):
            restore_replay_buffer(make_buffer(), tmp_path, saved)
    for n_envs, rows in ((2, CAPACITY), (1, CAPACITY + 1)):  # into a buffer of another size
        text = rf"has 10 rows of 1 environment\(s\), the model's has {rows} of {n_envs}"
        with pytest.raises(RunError, match=text):
            restore_replay_buffer(make_buffer(n_envs=n_envs, capacity=rows), tmp_path, saved)
