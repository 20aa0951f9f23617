"""The folder of a run: what is in it, who may use it, and a disk that is full."""

import contextlib
import os
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from stable_baselines3.common.callbacks import BaseCallback

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import ConfigError, RunError
from sb3_piano.music import load_score, write_midi
from sb3_piano.music.library import Library
from sb3_piano.training import RunFolder, resume, train


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
def test_score_and_finger_labels_are_copied_and_found_after_the_folder_was_moved(
    small_config, tmp_path, midi_file, monkeypatch, relative
):
    monkeypatch.chdir(tmp_path)
    given = midi_file.name if relative else str(midi_file)
    labels = tmp_path / "labels.csv"
    labels.write_text("onset,pitch,finger\n0,60,1\n")
    files = {"score": given, "fingering": str(labels)}
    folder = RunFolder.create(small_config(env_id="RoboPianist-v0", env_kwargs=files), "run")
    contents = [midi_file.read_bytes(), labels.read_bytes()]
    midi_file.unlink()
    labels.unlink()
    copies = {"score": "score.mid", "fingering": "fingering.csv"}
    assert yaml.safe_load(folder.config_file.read_text())["env_kwargs"] == copies
    assert yaml.safe_load(folder.provenance_file.read_text())["score_file"] == given
    moved = RunFolder(folder.path.rename(tmp_path / "moved"))
    found = {name: str(moved.path / copy) for name, copy in copies.items()}
    assert moved.read_config().env_kwargs == found
    assert [(moved.path / copy).read_bytes() for copy in copies.values()] == contents
    moved.write_config(moved.read_config())
    assert yaml.safe_load(moved.config_file.read_text())["env_kwargs"] == copies
    # A copy of a copy is known by the first file.
    second = RunFolder.create(moved.read_config(), tmp_path / "second")
    assert second.read_provenance()["score_file"] == given
    assert second.read_config().env_kwargs["score"] == str(second.path / "score.mid")


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
    # The name of a piece of the package stays a name, also beside a folder that is called so.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "CMajorScaleOneHand").mkdir()
    config = small_config(env_id="RoboPianist-v0", env_kwargs={"score": "CMajorScaleOneHand"})
    folder = RunFolder.create(config, tmp_path / "other")
    assert folder.read_config().env_kwargs == {"score": "CMajorScaleOneHand"}
    assert {path.name for path in folder.path.iterdir()} == {"config.yml", "run.yml"}


def test_what_a_killed_process_began_of_a_folder_is_made_anew(small_config, tmp_path, monkeypatch):
    file, place = tmp_path / "mine.mid", tmp_path / "run"
    write_midi(load_score("hanon-01"), file)
    config = small_config(env_id="RoboPianist-v0", env_kwargs={"score": str(file)})

    def killed(folder, config):
        raise KeyboardInterrupt

    def full(path, text):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("sb3_piano.training.runs.folder.write_yaml", full)
        with pytest.raises(RunError, match="cannot be written: No space left on device"):
            RunFolder.create(config, place)
        assert not place.exists()  # an error leaves nothing
    with monkeypatch.context() as patch:
        patch.setattr(RunFolder, "write_config", killed)
        with pytest.raises(KeyboardInterrupt):
            RunFolder.create(config, place)
    assert {path.name for path in place.iterdir()} >= {"run.yml", "score.mid"}
    assert RunFolder.create(config, place).read_config().env_kwargs["score"].endswith("score.mid")


def test_a_folder_that_is_taken_or_cannot_be_written_is_refused(small_config, tmp_path):
    with (
        RunFolder(tmp_path / "run").owned(),  # as by another process that makes a run
        pytest.raises(RunError, match=f"run' is being trained by process {os.getpid()} on "),
    ):
        RunFolder.create(small_config(), tmp_path / "run")
    RunFolder.create(small_config(), tmp_path / "run")
    with pytest.raises(RunError, match=r"holds a run already: .* sb3-piano train --resume .*run"):
        RunFolder.create(small_config(), tmp_path / "run")
    with pytest.raises(RunError, match="is not empty: expected a new or empty one"):
        RunFolder.create(small_config(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(RunError, match=r"Folder '.*file/td3' cannot be written: Not a directory"):
        RunFolder.create(small_config(), runs_dir=tmp_path / "file")
    with pytest.raises(RunError, match=r"Folder '.*file' cannot be written: File exists"):
        RunFolder.create(small_config(), tmp_path / "file")


def test_what_is_no_run_or_a_damaged_one_is_named(tmp_path):
    with pytest.raises(RunError, match=r"There is no folder '.*none': expected a folder that 'sb3"):
        RunFolder.open(tmp_path / "none")
    with pytest.raises(RunError, match="is no run, it has no config.yml"):
        RunFolder.open(tmp_path)
    for content, message in (
        ("", "' holds NoneType"),
        ("algo: td3\n", "': env_id is missing"),
        ("algo: [", "' is not valid YAML"),
    ):
        (tmp_path / "config.yml").write_text(content)
        with pytest.raises(ConfigError, match=rf"config\.yml{message}"):
            RunFolder.open(tmp_path).read_config()


class SmallDisk:
    """A mounted disk of a few megabytes, by its folder."""

    def __init__(self, path: Path):
        self.path = path
        self._filler = path / "filler"

    def fill(self) -> None:
        """Write until there is no room left."""
        with contextlib.suppress(OSError), self._filler.open("ab", buffering=0) as file:
            while True:
                file.write(bytes(512))

    def make_room(self) -> None:
        """Undo :meth:`fill`."""
        self._filler.unlink()

    def protect(self) -> None:
        """Let nobody write any more."""
        subprocess.run(["mount", "-o", "remount,ro", str(self.path)], check=True)


class FillAt(BaseCallback):
    """Fill the disk of a folder after some steps; named in configs by its import path."""

    def __init__(self, path: str, steps: int):
        super().__init__()
        self._disk = SmallDisk(Path(path))
        self._steps = steps

    def _on_step(self) -> bool:
        if self.num_timesteps == self._steps:
            self._disk.fill()
        return True


@pytest.fixture
def disk(tmp_path):
    """Mount a disk; skip the test where that is not allowed."""
    path = tmp_path / "disk"
    path.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        pytest.skip("there is no mount")
    if done.returncode != 0:
        pytest.skip(f"no disk can be mounted: {done.stderr.strip()}")
    try:
        yield SmallDisk(path)
    finally:
        subprocess.run(["umount", "--lazy", str(path)], check=True)


def error_of(capfd, *arguments):
    """Run the command and return the one line that says what is wrong."""
    assert main([str(argument) for argument in arguments]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    return line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("episode", "vec_env"),
    [(5, "subproc"), (20, "dummy")],
    ids=["TensorBoard is the first to write", "the checkpoint is the first"],
)
def test_a_training_whose_disk_fills_up_goes_on_when_there_is_room(
    small_config, disk, vec_env, episode, episodes_of
):
    run = RunFolder(disk.path / "run")
    config = small_config(vec_env=vec_env, env_kwargs={"max_episode_steps": episode})
    told = (
        rf"'{run.path}' cannot be written any more: No space left on device\. Its last whole "
        rf"checkpoint, after 30 steps, is safe\. .* sb3-piano train --resume {run.path}$"
    )
    options = {"progress_bar": False, "checkpoint_every": 30}
    with pytest.raises(RunError, match=told):
        train(config, run.path, callbacks=[FillAt(str(disk.path), 35)], **options)
    assert Checkpoint.read(run.checkpoint_dir).num_timesteps == 30
    assert not list(run.path.rglob("*.partial"))
    full_at_once = {**options, "callbacks": [FillAt(str(disk.path), 1)]}
    disk.make_room()
    with pytest.raises(RunError, match=r"It had saved nothing yet\. When there is room, go on"):
        train(config, disk.path / "other", **full_at_once)
    disk.make_room()
    result = resume(run.path, **options)
    assert (result.started_at, result.num_timesteps) == (30, 100)
    assert all(entry["l"] == episode for entry in episodes_of(run.monitor_dir))


@pytest.mark.slow
def test_files_beside_a_training_are_refused_in_one_line_too(piano_run, disk, capfd):
    run = piano_run(0.0, "disk/run").path
    disk.fill()
    capfd.readouterr()
    for command in (["evaluate", run, "--episodes", "1"], ["play", run]):
        assert "No space left on device" in error_of(capfd, *command)
    disk.make_room()
    assert main(["evaluate", str(run), "--episodes", "1"]) == 0


@pytest.mark.slow
def test_a_folder_that_is_write_protected_is_named(pendulum_run, disk, capfd):
    run = pendulum_run("disk/run").path
    disk.protect()
    capfd.readouterr()
    line = error_of(capfd, "train", "--resume", run, "--steps", "60")
    assert f"'{run}/.lock' cannot be locked: Read-only file system" in line
    assert "Read-only file system" in error_of(
        capfd, "train", "--out", disk.path / "b", "--env", "Pendulum-v1"
    )
    assert "Read-only file system" in error_of(capfd, "evaluate", run)
