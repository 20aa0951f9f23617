"""A run's folder is new, complete and can be moved."""

from __future__ import annotations

import os
import shlex
import shutil
from pathlib import Path

import pytest
import yaml

from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import load_score
from sb3_piano.music.library import Library
from sb3_piano.training import RunFolder


def test_runs_are_numbered_from_one_and_gaps_are_filled(small_config, tmp_path):
    paths = [RunFolder.create(small_config(), runs_dir=tmp_path).path for _ in range(3)]
    assert [path.relative_to(tmp_path).as_posix() for path in paths] == [
        "td3/Pendulum-v1_1",
        "td3/Pendulum-v1_2",
        "td3/Pendulum-v1_3",
    ]
    shutil.rmtree(paths[1])
    assert RunFolder.create(small_config(), runs_dir=tmp_path).path == paths[1]


def test_the_folder_has_config_and_provenance(small_config, tmp_path):
    config = small_config()
    folder = RunFolder.create(config, tmp_path / "new" / "run")
    assert RunFolder.open(folder.path).read_config() == config
    notes = yaml.safe_load(folder.provenance_file.read_text())
    assert notes["seed"] == 1
    started_with = Path("/proc/self/cmdline").read_text().rstrip("\0").split("\0")
    assert shlex.split(notes["command"]) == started_with
    assert set(notes["versions"]) == {
        "sb3_piano", "stable_baselines3", "sb3_contrib", "gymnasium", "mujoco", "numpy", "torch",
        "python",
    }  # fmt: skip
    assert all(notes["versions"].values())


@pytest.mark.parametrize("relative", [True, False])
def test_a_score_file_is_copied_and_found_after_the_folder_was_moved(
    small_config, tmp_path, midi_file, monkeypatch, relative
):
    monkeypatch.chdir(tmp_path)
    given = midi_file.name if relative else str(midi_file)
    config = small_config(env_id="RoboPianist-v0", env_kwargs={"score": given})
    folder = RunFolder.create(config, "run")
    content = midi_file.read_bytes()
    midi_file.unlink()
    assert yaml.safe_load(folder.config_file.read_text())["env_kwargs"] == {"score": "score.mid"}
    assert yaml.safe_load(folder.provenance_file.read_text())["score_file"] == given
    moved = RunFolder(folder.path.rename(tmp_path / "moved"))
    assert moved.read_config().env_kwargs["score"] == str(tmp_path / "moved" / "score.mid")
    assert (tmp_path / "moved" / "score.mid").read_bytes() == content
    moved.write_config(moved.read_config())
    assert yaml.safe_load(moved.config_file.read_text())["env_kwargs"] == {"score": "score.mid"}


def test_a_score_file_keeps_its_suffix(small_config, tmp_path):
    (tmp_path / "etude.txt").write_text("//Version\n")
    config = small_config(
        env_id="RoboPianist-v0", env_kwargs={"score": str(tmp_path / "etude.txt")}
    )
    folder = RunFolder.create(config, tmp_path / "run")
    assert folder.read_config().env_kwargs["score"] == str(tmp_path / "run" / "score.txt")


def test_a_file_of_finger_labels_is_copied_beside_the_score(small_config, tmp_path, midi_file):
    labels = tmp_path / "labels.csv"
    labels.write_text("onset,pitch,finger\n0,60,1\n")
    files = {"score": str(midi_file), "fingering": str(labels)}
    folder = RunFolder.create(
        small_config(env_id="RoboPianist-v0", env_kwargs=files), tmp_path / "run"
    )
    labels.unlink()
    moved = RunFolder(folder.path.rename(tmp_path / "moved"))
    copy = tmp_path / "moved" / "fingering.csv"
    assert moved.read_config().env_kwargs["fingering"] == str(copy)
    assert copy.read_text() == "onset,pitch,finger\n0,60,1\n"
    assert yaml.safe_load(moved.config_file.read_text())["env_kwargs"] == {
        "score": "score.mid",
        "fingering": "fingering.csv",
    }


def test_an_imported_piece_is_copied_so_that_the_run_does_not_need_the_library(
    small_config, tmp_path, monkeypatch
):
    monkeypatch.setenv("SB3_PIANO_DATA", str(tmp_path / "data"))
    score = load_score("CMajorScaleOneHand")
    Library().add(score, "mine", source="a test", fingering="ours")
    config = small_config(env_id="RoboPianist-v0", env_kwargs={"score": "mine"})
    folder = RunFolder.create(config, tmp_path / "run")
    Library().remove("mine")
    copy = folder.read_config().env_kwargs["score"]
    assert copy == str(tmp_path / "run" / "score.npz")
    assert load_score(copy).notes == score.notes
    assert load_score(copy).title == "mine"


def test_the_name_of_a_piece_stays_a_name(small_config, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "CMajorScaleOneHand").mkdir()  # not what was meant
    config = small_config(env_id="RoboPianist-v0", env_kwargs={"score": "CMajorScaleOneHand"})
    folder = RunFolder.create(config, tmp_path / "run")
    assert folder.read_config().env_kwargs == {"score": "CMajorScaleOneHand"}
    assert {path.name for path in folder.path.iterdir()} == {"config.yml", "run.yml"}


def test_a_folder_that_holds_a_run_is_refused_with_the_way_to_resume_it(small_config, tmp_path):
    RunFolder.create(small_config(), tmp_path / "run")
    with pytest.raises(RunError, match=r"holds a run already: .* sb3-piano train --resume .*run"):
        RunFolder.create(small_config(), tmp_path / "run")


def test_a_folder_that_is_not_empty_is_refused(small_config, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(RunError, match="is not empty: expected a new or empty one"):
        RunFolder.create(small_config(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_folder_that_another_process_is_making_a_run_in_is_refused(small_config, tmp_path):
    with (
        RunFolder(tmp_path / "run").owned(),
        pytest.raises(RunError, match=f"run' is being trained by process {os.getpid()} on "),
    ):
        RunFolder.create(small_config(), tmp_path / "run")
    RunFolder.create(small_config(), tmp_path / "run")


def test_a_place_that_cannot_be_written_is_named_with_the_reason(small_config, tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunError, match=r"Folder '.*file/td3' cannot be written: Not a directory"):
        RunFolder.create(small_config(), runs_dir=tmp_path / "file")
    with pytest.raises(RunError, match=r"Folder '.*file' cannot be written: File exists"):
        RunFolder.create(small_config(), tmp_path / "file")


def test_a_folder_that_could_not_be_filled_is_taken_away(small_config, tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("sb3_piano.training.runs.folder.write_text", full)
    with pytest.raises(RunError, match="cannot be written: No space left on device"):
        RunFolder.create(small_config(), runs_dir=tmp_path)
    assert list((tmp_path / "td3").iterdir()) == []


def test_what_is_no_run_is_refused(tmp_path):
    with pytest.raises(RunError, match=r"There is no folder '.*none': expected a folder that 'sb3"):
        RunFolder.open(tmp_path / "none")
    with pytest.raises(RunError, match="is no run, it has no config.yml"):
        RunFolder.open(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", r"config\.yml' holds NoneType"),
        ("algo: td3\n", r"config\.yml': env_id is missing"),
        ("algo: [", r"config\.yml' is not valid YAML"),
    ],
)
def test_a_damaged_config_is_named(small_config, tmp_path, content, message):
    folder = RunFolder.create(small_config(), tmp_path / "run")
    folder.config_file.write_text(content)
    with pytest.raises(ConfigError, match=message):
        folder.read_config()
