"""Runs that are killed or interrupted from outside, in a process of their own."""

import os
import signal
import subprocess
import sys

import pytest
from fresh_python import run_python, running_python
from stable_baselines3 import SAC
from waiting import PATIENCE, wait_for
from yaml_rows import Tables

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import RunError
from sb3_piano.training import RunFolder, resume

tables = Tables(__file__)

pytestmark = pytest.mark.slow

COMMAND = [
    *("-m", "sb3_piano.cli", "train", "--env", "Pendulum-v1", "--config", "long.yml"),
    *("--out", "run", "--no-progress", "--seed", "1"),
]


@pytest.fixture
def long(tmp_path):
    """Write the settings of a long training on Pendulum."""
    small = "policy_kwargs: {net_arch: [8]}, learning_starts: 100, batch_size: 8, buffer_size: 2000"
    settings = f"n_timesteps: 1000000, {small}, env_kwargs: {{max_episode_steps: 50}}, device: cpu"
    (tmp_path / "long.yml").write_text(f"default: {{{settings}}}")


@pytest.mark.usefixtures("long")
def test_a_run_has_one_training_and_killed_at_any_time_goes_on_from_its_last_checkpoint(
    tmp_path, monkeypatch, capsys
):
    folder = RunFolder(tmp_path / "run")
    with running_python([*COMMAND, "--checkpoint-every", "100"], tmp_path) as training:
        process = training.process
        for file in (folder.checkpoint_dir / "checkpoint.json", folder.model_file):
            wait_for(file.exists, lambda: process.exitcode)

        # A second training is refused at once, but all may read.
        assert main(["train", "--resume", str(folder.path)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"Run '{folder.path}' is being trained by process {process.pid} on " in line
        assert main(["train", "--env", "Pendulum-v1", "--out", str(folder.path)]) == 2
        assert "is being trained by process" in capsys.readouterr().err
        assert main(["evaluate", str(folder.path), "--episodes", "1"]) == 0

        process.kill()
        process.join()
    saved = Checkpoint.read(folder.checkpoint_dir)  # raises if a file of it is missing
    assert saved.num_timesteps >= 100
    assert saved.num_timesteps % 100 == 0
    rows = []
    learn = SAC.learn

    def spy(model, *arguments, **options):
        rows.append(model.replay_buffer.size())
        return learn(model, *arguments, **options)

    monkeypatch.setattr(SAC, "learn", spy)
    target = saved.num_timesteps + 150
    result = resume(folder.path, target, progress_bar=False)
    assert rows == [min(saved.num_timesteps, 2000)]
    assert (result.started_at, result.num_timesteps) == (saved.num_timesteps, target)
    assert not (folder.path / ".lock").exists()


KILLED = """
import os, signal, sys
left, replace = int(sys.argv[1]), os.replace
def killed(*names):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    replace(*names)
os.replace = killed
from sb3_piano.cli import main
main(sys.argv[2:])
"""


@tables("number, command")
def test_the_same_command_makes_anew_what_a_killed_one_began(
    pendulum_run, tmp_path, monkeypatch, number, command
):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    monkeypatch.chdir(tmp_path)
    pendulum_run("trained")
    if "clone" in command:
        assert main(["record", "trained", "--episodes", "2", "--no-progress"]) == 0
    arguments = [*command.split(), "--no-progress"]
    killed = run_python(["-c", KILLED, str(number), *arguments], tmp_path)
    assert killed.returncode == -signal.SIGKILL
    assert list(tmp_path.rglob("*.partial"))
    with pytest.raises(RunError, match="Give the same command again, which makes it anew"):
        resume("made")
    assert main(arguments) == 0
    left = {path.suffix or path.name for path in tmp_path.rglob("*")}
    assert not left & {".partial", ".lock", ".unfinished"}


@pytest.mark.usefixtures("long")
def test_ctrl_c_saves_and_prints_how_to_go_on(tmp_path):
    monitor = tmp_path / "run" / "monitor" / "0.monitor.csv"
    process = subprocess.Popen(
        [sys.executable, *COMMAND, "--n-envs", "2", "--vec-env", "subproc"],
        cwd=tmp_path,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        wait_for(lambda: monitor.exists() and monitor.read_text().count("\n") > 3, process.poll)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: environments get it too
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        process.communicate()
    assert process.returncode == 130, err
    saved = Checkpoint.read(tmp_path / "run" / "checkpoint")
    assert saved.num_timesteps >= 200
    assert saved.replay.total == saved.num_timesteps / 2
    assert f"Interrupted after {saved.num_timesteps} of 1000000 steps." in out
    assert "sb3-piano train --resume run" in out
    assert "Traceback" not in err
