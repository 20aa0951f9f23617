"""Runs that are killed or interrupted from outside, in a process of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
import yaml
from stable_baselines3 import TD3

from sb3_piano.callbacks import Checkpoint
from sb3_piano.cli import main
from sb3_piano.exceptions import RunError
from sb3_piano.training import RunFolder, resume

pytestmark = pytest.mark.slow

DEADLINE = 180  # s; starting several processes takes long where others are at work


@pytest.fixture
def start(tmp_path):
    """Start a long training on Pendulum by command line; kill what is left at the end."""
    processes = []
    settings = {
        "n_timesteps": 1_000_000,
        "policy_kwargs": {"net_arch": [8]},
        "learning_starts": 100,
        "batch_size": 8,
        "buffer_size": 2000,
        "env_kwargs": {"max_episode_steps": 50},
        "device": "cpu",
    }
    (tmp_path / "long.yml").write_text(yaml.safe_dump({"default": settings}))

    def run(*options):
        command = [sys.executable, "-m", "sb3_piano.cli", "train", "--env", "Pendulum-v1"]
        command += ["--config", "long.yml", "--run", "run", "--no-progress", "--seed", "1"]
        process = subprocess.Popen(
            [*command, *options],
            cwd=tmp_path,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield run
    for process in processes:
        if process.poll() is None:
            process.kill()
        process.communicate()


def wait_for(condition, process):
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.02)


def test_a_run_has_one_training_and_killed_at_any_time_goes_on_from_its_last_checkpoint(
    start, tmp_path, monkeypatch, capsys
):
    process = start("--checkpoint-every", "100")
    folder = RunFolder(tmp_path / "run")
    wait_for(lambda: (folder.checkpoint_dir / "checkpoint.json").exists(), process)
    wait_for(folder.model_file.exists, process)

    # A second training is refused at once, but all may read.
    assert main(["train", "--resume", str(folder.path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"Run '{folder.path}' is being trained by process {process.pid} on " in line
    assert main(["train", "--env", "Pendulum-v1", "--run", str(folder.path)]) == 2
    assert "is being trained by process" in capsys.readouterr().err
    assert main(["evaluate", str(folder.path), "--episodes", "1"]) == 0

    process.kill()
    process.wait()
    saved = Checkpoint.read(folder.checkpoint_dir)  # raises if a file of it is missing
    assert saved.num_timesteps >= 100
    assert saved.num_timesteps % 100 == 0
    rows = []
    learn = TD3.learn

    def spy(model, *arguments, **options):
        rows.append(model.replay_buffer.size())
        return learn(model, *arguments, **options)

    monkeypatch.setattr(TD3, "learn", spy)
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


@pytest.mark.parametrize(
    ("number", "command"),
    [
        (1, "train --env Pendulum-v1 --steps 100 --run made"),  # before run.yml has its name
        (6, "clone robopianist/Pendulum-v1/td3-v0 --epochs 2 --hidden 8 --run made"),
        (5, "export trained made --episodes 2 --no-video"),
    ],
)
def test_the_same_command_makes_anew_what_a_killed_one_began(
    pendulum_run, tmp_path, monkeypatch, number, command
):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "datasets"))
    monkeypatch.chdir(tmp_path)
    pendulum_run("trained")
    if "clone" in command:
        assert main(["record", "trained", "--episodes", "2", "--no-progress"]) == 0
    arguments = [*command.split(), "--no-progress"]
    killed = subprocess.run([sys.executable, "-c", KILLED, str(number), *arguments])
    assert killed.returncode == -signal.SIGKILL
    assert list(tmp_path.rglob("*.partial"))
    with pytest.raises(RunError, match="Give the same command again, which makes it anew"):
        resume("made")
    assert main(arguments) == 0
    left = {path.suffix or path.name for path in tmp_path.rglob("*")}
    assert not left & {".partial", ".lock", ".unfinished"}


@pytest.mark.parametrize(("vec_env", "n_envs"), [("processes", 2), ("subproc", 1)])
def test_ctrl_c_saves_and_prints_how_to_go_on(start, tmp_path, vec_env, n_envs):
    process = start("--n-envs", str(n_envs), "--vec-env", vec_env)
    monitor = tmp_path / "run" / "monitor" / "0.monitor.csv"
    wait_for(lambda: monitor.exists() and monitor.read_text().count("\n") > 3, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: environments get it too
    out, err = process.communicate(timeout=DEADLINE)
    assert process.returncode == 130, err
    saved = Checkpoint.read(tmp_path / "run" / "checkpoint")
    assert saved.num_timesteps >= 100 * n_envs
    assert saved.replay.total == saved.num_timesteps / n_envs
    assert f"Interrupted after {saved.num_timesteps} of 1000000 steps." in out
    assert "sb3-piano train --resume run" in out
    assert "Traceback" not in err
