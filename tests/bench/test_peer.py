"""The peer in a process of its own: what goes over the pipe, and every way it can fail."""

from __future__ import annotations

import json
import signal
import sys

import numpy as np
import pytest

from sb3_piano.bench import ENV_ID, PeerError, workloads
from sb3_piano.bench.workloads import PEER_INSTALL, open_peer

ACTIONS = np.array([[0.5, -1.0], [0.25, 0.0]], dtype=np.float32)

# Speaks as the script for RoboPianist does, and notes down what it hears.
DOUBLE = """
import json, pathlib, sys
heard = pathlib.Path(__file__).with_suffix(".heard")
for line in sys.stdin:
    with heard.open("a") as file:
        file.write(line)
    message = json.loads(line)
    if isinstance(message, list):
        answer = {"robopianist": "1.0.10", "python": "3.9"}
    else:
        answer = len(message), 0.5
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def double(tmp_path, monkeypatch):
    """Return a function that opens a peer which runs the given code."""

    def start(code):
        script = tmp_path / "double.py"
        script.write_text(code)
        monkeypatch.setattr(workloads, "_PEER_SCRIPT", script)
        return open_peer(sys.executable, ACTIONS)

    return start


@pytest.fixture
def processes(monkeypatch):
    """List the processes that are started."""
    started = []
    real = workloads.subprocess.Popen

    def popen(*args, **kwargs):
        started.append(real(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr(workloads.subprocess, "Popen", popen)
    return started


def test_the_peer_is_told_what_to_play_and_answers(double, tmp_path):
    with double(DOUBLE) as (versions, ask):
        assert versions == {"robopianist": "1.0.10", "python": "3.9"}
        assert ask("physics") == [7, 0.5]
        assert ask("env") == [3, 0.5]
    heard = [json.loads(line) for line in (tmp_path / "double.heard").read_text().splitlines()]
    assert heard == [[ENV_ID, [[0.5, -1.0], [0.25, 0.0]]], "physics", "env"]


@pytest.mark.parametrize("more", ["", "\nimport time\ntime.sleep(30)"])
def test_the_process_ends_with_the_context(double, processes, more):
    with double(DOUBLE + more):
        assert processes[0].poll() is None
    assert processes[0].returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import sys; sys.exit('no libGL')", "gave no answer: no libGL"),
        ("input()", "gave no answer: no error shown"),
        ("print('hello')", "gave no answer: no error shown"),
        (DOUBLE.replace("1.0.10", "1.0.9"), "has robopianist 1.0.9"),
    ],
)
def test_a_peer_that_does_not_start_says_why_and_leaves_no_process(
    double, processes, code, message
):
    with pytest.raises(PeerError) as caught, double(code):
        pass
    assert str(caught.value) == (
        f"The peer interpreter '{sys.executable}' {message}. Expected the Python of an environment "
        f"made with: {PEER_INSTALL}"
    )
    assert processes[0].poll() is not None


def test_a_peer_that_fails_while_it_plays_is_told(double):
    broken = DOUBLE.replace("len(message)", '1 / (message == "env")')
    with double(broken) as (_, ask):
        ask("env")
        with pytest.raises(PeerError, match="gave no answer: ZeroDivisionError"):
            ask("physics")


# A RoboPianist of one hinge, for the script that is meant for the real one. It prints, as libraries
# do, and counts what is asked of it.
SUITE = """
import mujoco, types
MODEL = "<mujoco><option timestep='0.005'/><worldbody><body><joint name='j'/><geom size='1'/>" \\
    "</body></worldbody><actuator><motor joint='j'/></actuator></mujoco>"
class Env:
    def __init__(self, env_id, task_kwargs):
        print("loading", env_id)
        model = mujoco.MjModel.from_xml_string(MODEL)
        self.physics = types.SimpleNamespace(
            model=types.SimpleNamespace(ptr=model), data=mujoco.MjData(model),
            timestep=lambda: model.opt.timestep)
        self.timestep = task_kwargs["control_timestep"]
    def control_timestep(self):
        return self.timestep
    def reset(self):
        pass
    def step(self, action):
        assert action.dtype == "float32", action
        self.physics.data.ctrl[:] = action[0]
        mujoco.mj_step(self.physics.model.ptr, self.physics.data, nstep=10)
def load(env_id, seed, task_kwargs):
    return Env(env_id, task_kwargs)
"""
WRAPPERS = """
class Wrapper:
    def __init__(self, env, **options):
        print("wrapping")
        self.env = env
    def reset(self):
        return self.env.reset()
    def step(self, action):
        return self.env.step(action)
EpisodeStatisticsWrapper = ObservationActionRewardWrapper = ConcatObservationWrapper = Wrapper
CanonicalSpecWrapper = SinglePrecisionWrapper = DmControlWrapper = Wrapper
"""


@pytest.fixture
def small_robopianist(tmp_path, monkeypatch):
    """Put a small RoboPianist where the peer's interpreter finds it; return its suite's file."""
    (tmp_path / "robopianist").mkdir()
    suite = tmp_path / "robopianist" / "suite.py"
    suite.write_text(SUITE)
    (tmp_path / "dm_env_wrappers.py").write_text(WRAPPERS)
    for name in ("robopianist", "dm_control"):
        metadata = tmp_path / f"{name}-1.0.10.dist-info"
        metadata.mkdir()
        (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0.10")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return suite


def test_the_script_plays_both_ways_whatever_libraries_print(small_robopianist):
    with open_peer(sys.executable, ACTIONS) as (versions, ask):
        assert versions["robopianist"] == "1.0.10"
        assert {"mujoco", "numpy", "python"} < set(versions)
        for workload in ("env", "physics", "env"):
            steps, seconds = ask(workload)
            assert steps == len(ACTIONS)
            assert seconds > 0
