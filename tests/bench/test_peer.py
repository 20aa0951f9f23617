"""The peer in a process of its own: what goes over the pipe, and every way it can fail."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

import sb3_piano.bench.peer.client as client
from sb3_piano.bench.peer import INSTALL, Peer, PeerError
from sb3_piano.bench.settings import ENV_ID

ACTIONS = np.array([[0.5, -1.0], [0.25, 0.0]], dtype=np.float32)

# Speaks as the script for RoboPianist does, and notes down what it hears.
DOUBLE = """
import json, pathlib, sys
heard = pathlib.Path(__file__).with_suffix(".heard")
for line in sys.stdin:
    with heard.open("a") as file:
        file.write(line)
    message = json.loads(line)
    if "actions" in message:
        answer = {"robopianist": "1.0.10", "python": "3.9"}
    else:
        answer = {"steps": len(message["play"]), "seconds": 0.5}
    print(json.dumps(answer), flush=True)
"""


@pytest.fixture
def double(tmp_path):
    """Return a function that starts a peer which runs the given code."""

    def start(code: str) -> Peer:
        script = tmp_path / "double.py"
        script.write_text(code)
        return Peer(sys.executable, ACTIONS, script)

    return start


def test_the_peer_is_told_what_to_play_and_answers_with_laps(double, tmp_path):
    with double(DOUBLE) as peer:
        assert peer.versions == {"robopianist": "1.0.10", "python": "3.9"}
        lap = peer.play("physics")
        assert (lap.steps, lap.seconds, lap.rate) == (7, 0.5, 14.0)
        assert peer.play("env").steps == 3
    heard = [json.loads(line) for line in (tmp_path / "double.heard").read_text().splitlines()]
    first = {"env_id": ENV_ID, "actions": [[0.5, -1.0], [0.25, 0.0]]}
    assert heard == [first, {"play": "physics"}, {"play": "env"}]


def test_the_process_ends_with_the_context(double):
    with double(DOUBLE) as peer:
        process = peer._process
        assert process.poll() is None
    assert process.poll() is not None


def test_a_process_that_would_go_on_is_ended(double):
    with double(DOUBLE + "\nimport time\ntime.sleep(30)") as peer:
        process = peer._process
    assert process.returncode == -signal.SIGKILL


def test_what_it_prints_as_an_error_does_not_stop_it(double):
    with double("import sys; print('x' * 10**6, file=sys.stderr, flush=True)" + DOUBLE) as peer:
        assert peer.play("env").steps == 3


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import sys; sys.exit('no libGL')", "ended without an answer: no libGL"),
        ("input()", "ended without an answer: no error told"),
        ("print('hello')", "answered 'hello', which this command did not expect"),
        ("print('[1]')", "answered '[1]', which this command did not expect"),
        (
            DOUBLE.replace("1.0.10", "1.0.9"),
            "has robopianist 1.0.9, not 1.0.10",
        ),
        (DOUBLE.replace('"robopianist"', '"error"'), "cannot run RoboPianist: 1.0.10"),
    ],
)
def test_a_peer_that_does_not_start_says_why_and_what_to_install(double, code, message):
    with pytest.raises(PeerError) as caught:
        double(code)
    assert str(caught.value) == (
        f"The peer interpreter '{sys.executable}' {message}. Expected the Python of an environment "
        f"made with: {INSTALL}"
    )


def test_a_peer_that_does_not_start_leaves_no_process(double, monkeypatch):
    started = []
    real = client.subprocess.Popen

    def popen(*args, **kwargs):
        started.append(real(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr(client.subprocess, "Popen", popen)
    with pytest.raises(PeerError, match="not 1.0.10"):
        double(DOUBLE.replace("1.0.10", "1.0.9"))
    assert [process.poll() is None for process in started] == [False]


def test_a_peer_that_fails_while_it_plays_is_told(double):
    broken = DOUBLE.replace('len(message["play"])', '1 / (message["play"] == "env")')
    with double(broken) as peer:
        peer.play("env")
        with pytest.raises(PeerError, match="ended without an answer: ZeroDivisionError"):
            peer.play("physics")


def test_a_peer_that_has_gone_is_told(double):
    with double(DOUBLE + "    sys.exit('tired')") as peer:
        peer._process.wait()
        with pytest.raises(PeerError, match="ended without an answer: tired"):
            peer.play("env")


def test_an_interpreter_that_is_not_there_is_named():
    with pytest.raises(PeerError, match="'nowhere/python' cannot be started: No such file"):
        Peer("nowhere/python", ACTIONS)


def test_an_interpreter_without_robopianist_is_told_what_to_install():
    with pytest.raises(PeerError) as caught:
        Peer(sys.executable, ACTIONS)
    text = str(caught.value)
    assert "cannot run RoboPianist: PackageNotFoundError" in text
    assert 'pip install robopianist==1.0.10 "mujoco==3.17.*" "numpy<2" "pandas<2.3"' in text


# A RoboPianist of one hinge, for the script that is meant for the real one. It prints, as libraries
# do, and counts what is asked of it.
SUITE = """
import mujoco, types
MODEL = "<mujoco><option timestep='0.005'/><worldbody><body><joint name='j'/><geom size='1'/>" \\
    "</body></worldbody><actuator><motor joint='j'/></actuator></mujoco>"
LENGTH = 2
class Env:
    def __init__(self, env_id, task_kwargs):
        print("loading", env_id)
        model = mujoco.MjModel.from_xml_string(MODEL)
        self.physics = types.SimpleNamespace(
            model=types.SimpleNamespace(ptr=model), data=mujoco.MjData(model))
        self.timestep = task_kwargs["control_timestep"]
    def control_timestep(self):
        return self.timestep
    def reset(self):
        self.steps = 0
    def step(self, action):
        assert action.dtype == "float32", action
        self.physics.data.ctrl[:] = action[0]
        mujoco.mj_step(self.physics.model.ptr, self.physics.data, nstep=10)
        self.steps += 1
        assert self.steps <= LENGTH, "stepped beyond the end"
        return types.SimpleNamespace(last=lambda: self.steps == LENGTH)
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
    metadata = tmp_path / "robopianist-1.0.10.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: robopianist\nVersion: 1.0.10")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return suite


def test_the_script_plays_both_ways_whatever_libraries_print(small_robopianist):
    with Peer(sys.executable, ACTIONS) as peer:
        assert peer.versions["robopianist"] == "1.0.10"
        assert {"mujoco", "numpy", "python"} < set(peer.versions)
        for what in ("env", "physics", "env"):
            lap = peer.play(what)
            assert lap.steps == len(ACTIONS)
            assert lap.seconds > 0


@pytest.mark.slow
def test_the_script_plays_the_same_controls_with_mujoco_alone(small_robopianist, tmp_path):
    noted = SUITE + (
        "real, file = mujoco.mj_step, open(__file__ + '.steps', 'a', buffering=1)\n"
        "def mj_step(model, data, nstep):\n"
        "    print(nstep, data.time, *data.ctrl, file=file)\n"
        "    real(model, data, nstep=nstep)\n"
        "mujoco.mj_step = mj_step\n"
    )
    small_robopianist.write_text(noted)
    with Peer(sys.executable, ACTIONS) as peer:
        for _ in range(2):
            peer.play("physics")
    steps = (tmp_path / "robopianist" / "suite.py.steps").read_text().splitlines()
    # first the script plays the environment to see the controls; its steps are of 10 x 0.005 s
    first, second = steps[:2]
    assert first == "10 0.0 0.5"
    assert second.startswith("10 0.0")
    assert second.endswith(" 0.25")
    assert steps == [first, second] * 3


def test_the_script_refuses_actions_beyond_the_end(small_robopianist):
    small_robopianist.write_text(SUITE.replace("LENGTH = 2", "LENGTH = 1"))
    message = "cannot run RoboPianist: ValueError: the episode has 1 steps, not 2"
    with pytest.raises(PeerError, match=message):
        Peer(sys.executable, ACTIONS)


def test_the_script_finds_no_modules_of_ours_beside_it():
    """Its folder comes first on its search path."""
    beside = {path.stem for path in Path(client.__file__).parent.glob("*.py")}
    assert not beside & (set(sys.stdlib_module_names) | {"robopianist", "mujoco", "numpy"})
