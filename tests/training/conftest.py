"""What the tests of training share: tiny settings for an environment that costs nothing."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pretty_midi
import pytest
import torch
from stable_baselines3 import TD3

from sb3_piano.training import RunConfig, RunFolder, train

SMALL = {"learning_starts": 20, "batch_size": 8, "buffer_size": 200}
ON_POLICY = ("ppo", "a2c", "trpo")


@pytest.fixture(autouse=True)
def _one_thread():
    torch.set_num_threads(1)


@pytest.fixture
def small_config():
    """Return a function that makes a config of a tiny TD3 on Pendulum, episodes of 20 steps."""

    def make(**changes):
        small = {"n_steps": 20} if changes.get("algo") in ON_POLICY else SMALL
        small = {"policy_kwargs": {"net_arch": [8]}, "device": "cpu", **small}
        algorithm_kwargs = {**small, **changes.pop("algorithm_kwargs", {})}
        settings = {
            "algo": "td3",
            "env_id": "Pendulum-v1",
            "n_timesteps": 100,
            "seed": 1,
            "env_kwargs": {"max_episode_steps": 20},
            "algorithm_kwargs": algorithm_kwargs,
        }
        return RunConfig(**{**settings, **changes})

    return make


@pytest.fixture
def run(small_config, tmp_path):
    """Train a tiny model and return the result."""

    def start(every=30, **changes):
        return train(
            small_config(**changes), tmp_path / "run", progress_bar=False, checkpoint_every=every
        )

    return start


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """Return a function that trains once with each config, and gives a copy of the run's folder."""
    runs = {}

    def make(config, place):
        if repr(config) not in runs:
            folder = tmp_path_factory.mktemp("trained") / "run"
            runs[repr(config)] = train(config, folder, progress_bar=False).folder
        return RunFolder(shutil.copytree(runs[repr(config)].path, place))

    return make


@pytest.fixture
def piano_run(small_config, trained, tmp_path, duet):
    """Return a function that makes a run on a MIDI file whose model always does one action."""

    def make(action, name="run", **env_kwargs):
        config = small_config(
            env_id="RoboPianist-v0",
            env_kwargs={"score": str(duet), **env_kwargs},
            n_timesteps=1,
        )
        folder = RunFolder(tmp_path / name)
        if not folder.config_file.is_file():
            trained(config, folder.path)
        model = TD3.load(folder.model_file)
        layer = model.actor.mu[-2]
        with torch.no_grad():
            layer.weight.zero_()
            layer.bias.copy_(torch.as_tensor(np.arctanh(np.clip(action, -0.9999999, 0.9999999))))
        model.save(folder.model_file)
        return folder

    return make


@pytest.fixture
def pendulum_run(small_config, trained, tmp_path):
    """Return a function that makes a run on Pendulum and returns its folder."""

    def make(name="run", **changes):
        return trained(small_config(**{"n_timesteps": 30, **changes}), tmp_path / name)

    return make


@pytest.fixture
def written(tmp_path) -> Callable[..., Path]:
    """Return a function that writes what evaluation writes: metrics by piece and seed."""

    def write(name, pieces, physics="fast"):
        entries = [
            {
                "piece": piece,
                "env_kwargs": {"physics": physics},
                "episode_seeds": [seed for seed, _ in episodes],
                "episodes": [metrics for _, metrics in episodes],
            }
            for piece, episodes in pieces.items()
        ]
        path = tmp_path / name
        path.write_text(json.dumps({"evaluations": entries}))
        return path

    return write


@pytest.fixture
def episodes_of() -> Callable[[Path], list[dict[str, float]]]:
    """Return a function that reads the Monitor files of a folder, in the order of their names."""

    def read(folder: Path) -> list[dict[str, float]]:
        rows = []
        for path in sorted(folder.glob("*.monitor.csv")):
            first, *lines = path.read_text().splitlines()
            assert first.startswith('#{"t_start":')
            rows += [{k: float(v) for k, v in row.items()} for row in csv.DictReader(lines)]
        return rows

    return read


@pytest.fixture(scope="session")
def duet(tmp_path_factory) -> Path:
    """A MIDI file of two tracks, with overlapping notes and the pedal; 1.2 s long."""
    music = pretty_midi.PrettyMIDI()
    right, left = pretty_midi.Instrument(0, name="right"), pretty_midi.Instrument(0, name="left")
    right.notes = [pretty_midi.Note(80, 72, 0.0, 0.7), pretty_midi.Note(80, 76, 0.4, 1.2)]
    left.notes = [pretty_midi.Note(80, 48, 0.0, 1.0)]
    left.control_changes = [
        pretty_midi.ControlChange(64, 127, 0.2),
        pretty_midi.ControlChange(64, 0, 0.9),
    ]
    music.instruments = [right, left]
    path = tmp_path_factory.mktemp("music") / "duet.mid"
    music.write(str(path))
    return path


@pytest.fixture
def midi_file(duet, tmp_path) -> Path:
    """A copy of that file, which a test may move or delete."""
    return Path(shutil.copy(duet, tmp_path))
