"""A disk that is full or cannot be written to: one line, nothing lost, and the way to go on."""

from __future__ import annotations

import pytest
import yaml
from small_disk import FillAt, small_disk

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import RunError
from sb3_piano.training import RunFolder, resume, train

pytestmark = pytest.mark.slow


@pytest.fixture
def disk(tmp_path):
    with small_disk(tmp_path / "disk") as disk:
        yield disk


def error_of(capfd, *arguments):
    """Run the command and return the one line that says what is wrong."""
    assert main([str(argument) for argument in arguments]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize("vec_env", ["dummy", "subproc"])
@pytest.mark.parametrize(
    "episode", [5, 20], ids=["TensorBoard is the first to write", "the checkpoint is the first"]
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
    disk.make_room()
    result = resume(run.path, **options)
    assert (result.started_at, result.num_timesteps) == (30, 100)
    assert all(entry["l"] == episode for entry in episodes_of(run.monitor_dir))


def test_a_training_whose_disk_is_full_at_once_says_that_nothing_is_saved(small_config, disk):
    with pytest.raises(RunError, match=r"It had saved nothing yet\. When there is room, go on"):
        train(
            small_config(),
            disk.path / "run",
            callbacks=[FillAt(str(disk.path), 1)],
            progress_bar=False,
            checkpoint_every=30,
        )


def test_the_command_tells_it_in_one_line(small_config, disk, tmp_path, capfd):
    settings = {"policy_kwargs": {"net_arch": [8]}, "learning_starts": 20, "buffer_size": 200}
    fill = {"small_disk.FillAt": {"path": str(disk.path), "steps": 35}}
    config = {"default": {**settings, "callback": [fill], "n_timesteps": 100}}
    (tmp_path / "small.yml").write_text(yaml.safe_dump(config))
    run = disk.path / "run"
    command = ["train", "--env", "Pendulum-v1", "--config", tmp_path / "small.yml", "--run", run]
    line = error_of(capfd, *command, "--checkpoint-every", "30", "--no-progress")
    assert "after 30 steps, is safe" in line
    assert f"sb3-piano train --resume {run}" in line


def test_files_beside_a_training_are_refused_in_one_line_too(piano_run, disk, capfd):
    run = piano_run(0.0, "disk/run").path
    disk.fill()
    capfd.readouterr()
    for command in (["evaluate", run, "--episodes", "1"], ["play", run]):
        assert "No space left on device" in error_of(capfd, *command)
    disk.make_room()
    assert main(["evaluate", str(run), "--episodes", "1"]) == 0


def test_a_folder_that_is_write_protected_is_named(pendulum_run, disk, capfd):
    run = pendulum_run("disk/run").path
    disk.protect()
    capfd.readouterr()
    line = error_of(capfd, "train", "--resume", run, "--steps", "60")
    assert f"'{run}/.lock' cannot be locked: Read-only file system" in line
    assert "Read-only file system" in error_of(
        capfd, "train", "--run", disk.path / "b", "--env", "Pendulum-v1"
    )
    assert "Read-only file system" in error_of(capfd, "evaluate", run)
