"""Data sets whose files are damaged: one clear error, or other numbers."""

import json

import h5py
import numpy as np
import pytest
from damage import told, variants_of

from sb3_piano.demonstrations.dataset import Transitions
from sb3_piano.exceptions import ConfigError
from sb3_piano.training import clone

NAME = "test/pendulum-v0"
QUICK = {"algo": "td3", "epochs": 1, "net_arch": [4], "seed": 0}


def test_a_file_that_is_cut_off_or_changed_is_named(pendulum_data, datasets, tmp_path):
    pendulum_data()
    file = datasets / NAME / "data" / "main_data.hdf5"
    content = file.read_bytes()
    cut, changed = variants_of(content, 30, change=lambda part: bytes(64))
    refused = 0
    for variant in [*cut, *changed]:
        file.write_bytes(variant)
        line = told(ConfigError, lambda: Transitions.of(NAME))
        if line is not None:
            refused += 1
            assert f"Data set '{NAME}' in '{datasets / NAME}' cannot be read" in line
            assert "\n" not in line
    assert refused >= 30
    file.write_bytes(content[: len(content) // 2])
    with pytest.raises(ConfigError, match="cannot be read .* expected what Minari wrote"):
        clone(NAME, folder=tmp_path / "run", **QUICK)
    assert not (tmp_path / "run").exists()


def test_damaged_metadata_is_named(pendulum_data, datasets, tmp_path):
    pendulum_data()
    file = datasets / NAME / "data" / "metadata.json"
    content = file.read_bytes()
    for end in np.linspace(0, len(content) - 1, 8).astype(int):
        file.write_bytes(content[:end])
        with pytest.raises(ConfigError, match=f"Data set '{NAME}' in .* cannot be read"):
            clone(NAME, folder=tmp_path / "run", **QUICK)
    found = json.loads(content)
    for key in sorted(found)[::2]:
        file.write_text(json.dumps({**found, key: "\x00"}))
        line = told(ConfigError, lambda: clone(NAME, folder=tmp_path / key, **QUICK))  # noqa: B023
        assert line is None or f"Data set '{NAME}'" in line


def of_size(name, **claims):
    """Return what puts an array that claims a size into an episode, of which no byte is there."""

    def change(file):
        if f"episode_0/{name}" in file:
            del file[f"episode_0/{name}"]
        file.create_dataset(f"episode_0/{name}", dtype="f8", **claims)

    return change


def linked(file):
    del file["episode_0/rewards"]
    file["episode_0/rewards"] = h5py.ExternalLink("other.hdf5", "rewards")


def in_itself(file):
    file["episode_0/infos/a"] = file["episode_0/infos/b"] = file["episode_0/infos"]


def texts(file):
    shape = file["episode_0/actions"].shape
    del file["episode_0/actions"]
    file["episode_0/actions"] = np.full(shape, b"x")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (of_size("rewards", shape=(10**8,)), "more than its size"),
        (of_size("infos/x", shape=(10**9,), chunks=(10**6,)), "more than its size"),
        (of_size("rewards", shape=(9,), external=[("/dev/zero", 0, 72)]), "stands elsewhere"),
        (linked, "stands elsewhere"),
        (in_itself, "more than its size"),
        (texts, "actions of episode 0 are no numbers"),
    ],
)
def test_what_a_file_only_claims_is_refused_before_it_is_read(
    pendulum_data, datasets, change, said
):
    pendulum_data()
    with h5py.File(datasets / NAME / "data" / "main_data.hdf5", "r+") as file:
        file.require_group("episode_0/infos")
        change(file)
    with pytest.raises(ConfigError, match=said):
        Transitions.of(NAME)
