"""What the tests of demonstrations share: a folder for data sets, short pieces, simple players."""

import gymnasium as gym
import pytest
from linear_players import Linear, pendulum

import sb3_piano  # noqa: F401  registers the environments
from sb3_piano.demonstrations import record
from sb3_piano.music import Note, Score, write_midi


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    """Give a new folder in which Minari keeps its data sets."""
    folder = tmp_path / "datasets"
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return folder


@pytest.fixture
def piece(tmp_path):
    """Return the file of a piece of two notes, 13 control steps long."""
    notes = [Note(onset=0.0, offset=0.3, pitch=60), Note(onset=0.3, offset=0.6, pitch=62)]
    path = tmp_path / "two notes.mid"
    write_midi(Score(notes=notes), path)
    return path


@pytest.fixture
def piano(piece):
    """Return a function that makes a piano environment for the piece."""

    def make(**options):
        shared = {"physics": "fast", "observation": "fingers", "fingering": "ergonomic"}
        return gym.make("RoboPianist-v0", score=str(piece), **{**shared, **options})

    return make


@pytest.fixture
def pendulum_data():
    """Return a function that records a linear player of the Pendulum."""

    def make(name="test/pendulum-v0", episodes=3, wrap=lambda env: env, **options):
        env = wrap(pendulum())
        return record(Linear(env), env, name, episodes=episodes, **options).dataset

    return make
