"""Recorded performances: what is in the data set is what the environment did."""

import os
import resource
import signal
from pathlib import Path

import gymnasium as gym
import minari
import numpy as np
import pytest
from linear_players import Linear, pendulum
from minari.namespace import list_local_namespaces
from yaml_rows import Tables

from sb3_piano.demonstrations import EXPERT_ACTION, PerturbedStart, open_dataset, record
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import load_score
from sb3_piano.players.sampling import PredictiveSampling
from sb3_piano.unfinished import own

tables = Tables(__file__)

NAME = "robopianist/two-notes/linear-v0"


def recorded(env=None, **options):
    """Record a linear player, of the Pendulum unless told otherwise."""
    env = env or pendulum()
    return record(Linear(env), env, NAME, **options)


def notes_of(dataset):
    return list(dataset.storage.get_episode_metadata(dataset.episode_indices))


def replay(env, seed, actions):
    """Return what an environment does under some actions: observations, rewards, last info."""
    observations, rewards, info = [env.reset(seed=seed)[0]], [], {}
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
    return np.array(observations), rewards, (terminated, truncated), info


def all_arrays(dataset):
    return [
        array
        for episode in dataset
        for array in (episode.observations, episode.actions, episode.infos[EXPERT_ACTION])
    ]


def test_the_recorded_actions_from_the_recorded_seed_give_the_same_again(piano):
    recorded(PerturbedStart(piano(), 0.05), episodes=3, noise=[0.0, 0.1])
    dataset = minari.load_dataset(NAME)
    again = dataset.recover_environment()
    assert len(dataset) == 3
    for episode, notes in zip(dataset, notes_of(dataset), strict=True):
        observations, rewards, ends, info = replay(again, notes["seed"], episode.actions)
        np.testing.assert_array_equal(observations, episode.observations)
        np.testing.assert_array_equal(rewards, episode.rewards)
        assert ends == (False, True)
        assert list(episode.truncations) == [False] * 12 + [True]
        assert not episode.terminations.any()
        assert {name: notes[name] for name in EPISODE_METRICS} == pytest.approx(
            {name: info[name] for name in EPISODE_METRICS}, nan_ok=True
        )
        assert notes["return"] == pytest.approx(sum(rewards))


def test_the_label_is_what_the_policy_would_do_in_the_disturbed_state(piano):
    env = piano()
    policy = Linear(env)
    dataset = record(policy, env, NAME, episodes=2, noise=[0.1]).dataset
    for episode in dataset:
        labels = episode.infos[EXPERT_ACTION]
        np.testing.assert_array_equal(labels[:-1], policy.act(episode.observations[:-1]))
        assert np.isnan(labels[-1]).all()
        moved = np.abs(episode.actions - labels[:-1]).mean(axis=0)
        assert (moved[:-1] > 0).all()
        assert moved[-1] == 0  # the pedal
        assert np.abs(episode.actions).max() <= 1


@pytest.mark.slow
def test_equal_seeds_record_the_same_and_others_something_else(piano):
    """Starts, noise, and what a player draws."""
    env = PerturbedStart(piano(), 0.05)
    player = PredictiveSampling(env, nominal="none", samples=2, n_threads=1)
    first, same, other = (
        all_arrays(record(player, env, f"t-v{i}", episodes=2, noise=[0.1], seed=s).dataset)
        for i, s in enumerate((4, 4, 5))
    )
    for array, again, different in zip(first, same, other, strict=True):
        np.testing.assert_array_equal(array, again)
        assert not np.array_equal(array, different)


def test_the_environment_for_evaluation_is_undisturbed_and_otherwise_the_same(piano, piece):
    env = PerturbedStart(piano(initial_buffer_time=0.1), 0.05)
    dataset = recorded(env).dataset
    clean = dataset.recover_environment(eval_env=True)
    assert isinstance(clean.unwrapped, PianoEnv)
    assert clean.unwrapped.config == env.unwrapped.config
    assert "PerturbedStart" not in str(clean)
    np.testing.assert_array_equal(clean.reset(seed=1)[0], clean.reset(seed=2)[0])
    disturbed = dataset.recover_environment()
    assert not np.array_equal(disturbed.reset(seed=1)[0], disturbed.reset(seed=2)[0])


def test_the_data_set_says_where_it_is_from_and_noises_take_turns(piano):
    told, how = [], {"noise": [0.0, 0.1], "seed": 3, "policy_name": "line"}
    result = recorded(piano(), episodes=5, on_episode=told.append, **how)
    dataset = result.dataset
    assert [notes["noise"] for notes in notes_of(dataset)] == [0, 0.1, 0, 0.1, 0]
    assert tuple(told) == result.episodes
    assert not result.interrupted
    found = dataset.storage.metadata
    assert found["algorithm_name"] == "line"
    assert found["sb3_piano"]["version"] in found["requirements"][0]
    assert found["sb3_piano"]["noise"] == [0.0, 0.1]
    assert found["sb3_piano"]["seed"] == 3
    assert list(minari.list_local_datasets()) == [NAME]
    assert set(list_local_namespaces()) == {"robopianist", "robopianist/two-notes"}
    assert minari.list_local_datasets(prefix="robopianist/two-notes").keys() == {NAME}
    with pytest.raises(ConfigError, match=rf"no data set 'other-v0' in .*\({NAME}\)"):
        open_dataset("other-v0")


def test_a_score_without_a_name_cannot_be_made_again(piece):
    env = gym.make("RoboPianist-v0", score=load_score(piece), physics="fast")
    with pytest.warns(UserWarning, match="Score is not JSON serializable"):
        dataset = recorded(env).dataset
    assert dataset.env_spec is None
    assert len(dataset[0]) == 13


def test_a_name_that_is_taken_is_refused_unless_it_may_be_overwritten(datasets):
    with pytest.raises(RunError, match=f"'{NAME}' is being recorded by .*: expected a new name"):
        recorded(on_episode=lambda notes: recorded())
    assert list(datasets.iterdir()) == []
    recorded(episodes=2)
    with pytest.raises(ConfigError, match=f"'{NAME}' already, in .*: expected a new name"):
        recorded()
    assert len(minari.load_dataset(NAME)) == 2
    recorded(episodes=3, overwrite=True)
    assert len(minari.load_dataset(NAME)) == 3
    assert [path.name for path in datasets.iterdir()] == ["robopianist"]


class Breaking(Linear):
    """Plays well for some steps, and then something happens."""

    def __init__(self, env, steps, happens):
        super().__init__(env)
        self._left, self._happens = steps, happens

    def predict(self, *args, **kwargs):
        if self._left == 0:
            self._happens()
        self._left -= 1
        return super().predict(*args, **kwargs)


def fail():
    raise ZeroDivisionError("a string broke")


def press_ctrl_c():
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_recording_that_fails_leaves_everything_as_it_was(datasets, overwrite):
    env = pendulum()
    if overwrite:
        recorded(env, episodes=2)
    before = sorted(datasets.rglob("*"))
    with pytest.raises(ZeroDivisionError, match="a string broke"):
        record(Breaking(env, 30, fail), env, NAME, episodes=2, overwrite=overwrite)
    assert sorted(datasets.rglob("*")) == before


def test_a_recording_that_the_disk_refuses_leaves_nothing_and_ends_in_an_error(datasets):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (2**19, limits[1]))
        with pytest.raises(OSError, match="File too large"):
            recorded(episodes=200)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert list(datasets.iterdir()) == []


def test_what_a_killed_recording_left_goes_with_the_next_and_others_stay(datasets, monkeypatch):
    dead, alive = datasets / ".recording-dead", datasets / ".recording-alive"
    for folder in (dead, alive):
        (folder / "new").mkdir(parents=True)
    owner = os.open(alive, os.O_RDONLY)
    own(owner)
    synced, sync = [], os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (synced.append(os.fstat(fd).st_ino), sync(fd)))
    recorded()
    os.close(owner)
    assert alive.exists()
    assert not dead.exists()
    written = [file for file in (datasets / NAME).rglob("*") if file.is_file()]
    assert {file.stat().st_ino for file in written} <= set(synced)  # before they were named


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_keeps_the_episodes_that_are_finished(datasets):
    env = pendulum()
    with pytest.raises(KeyboardInterrupt):  # in the first one
        record(Breaking(env, 5, press_ctrl_c), env, NAME)
    assert list(datasets.iterdir()) == []
    found = record(Breaking(env, 50, press_ctrl_c), env, NAME, episodes=9)
    assert found.interrupted
    assert len(found.episodes) == len(minari.load_dataset(NAME)) == 2


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize("number", [1, 2])
def test_ctrl_c_while_an_episode_is_written_waits_for_its_end(number, monkeypatch):
    from minari.dataset._storages.hdf5_storage import HDF5Storage

    write, written = HDF5Storage.update_episodes, []

    def pressed_meanwhile(self, episodes):
        written.append(1)
        if len(written) == number:
            press_ctrl_c()
        write(self, episodes)

    monkeypatch.setattr(HDF5Storage, "update_episodes", pressed_meanwhile)
    found = recorded(episodes=5)
    assert found.interrupted
    assert [len(episode) for episode in minari.load_dataset(NAME)] == [20] * number
    noted = [notes["return"] for notes in notes_of(found.dataset)]
    assert noted == [notes["return"] for notes in found.episodes]


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_while_a_data_set_is_replaced_waits_until_it_is(monkeypatch):
    recorded(episodes=2)
    rename = Path.rename

    def pressed_after(self, target):
        found = rename(self, target)
        press_ctrl_c()
        return found

    monkeypatch.setattr(Path, "rename", pressed_after)
    with pytest.raises(KeyboardInterrupt):
        recorded(episodes=3, overwrite=True)
    assert len(minari.load_dataset(NAME)) == 3


@pytest.mark.parametrize("name", ["no version-v0", "planned", "../up-v0", "a//b-v", "", "/a-v0"])
def test_names_that_minari_cannot_keep_are_refused(name, datasets):
    env = pendulum()
    with pytest.raises(ConfigError, match="is not valid: expected letters"):
        record(Linear(env), env, name)
    with pytest.raises(ConfigError, match="is not valid: expected letters"):
        open_dataset(name)
    assert not datasets.exists() or list(datasets.iterdir()) == []


@tables("options, message")
def test_what_is_out_of_range_is_refused(options, message, datasets):
    with pytest.raises(ConfigError, match=message):
        recorded(**options)
    assert not datasets.exists()
