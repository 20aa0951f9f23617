"""The peer in a process of its own: its end, and every way it can fail."""

import signal
import sys

import numpy as np
import pytest

from sb3_piano.lab.bench import workloads
from sb3_piano.lab.bench.workloads import PEER_INSTALL, PeerError, open_peer

ACTIONS = np.array([[0.5, -1.0], [0.25, 0.0]], dtype=np.float32)

# Speaks as the script for RoboPianist does.
DOUBLE = """
import json, sys
for line in sys.stdin:
    message = json.loads(line)
    first = isinstance(message, list)
    answer = {"robopianist": "1.0.10", "python": "3.9"} if first else (len(message), 0.5)
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


def test_a_peer_that_fails_while_it_plays_is_told_and_its_process_ends_with_the_context(
    double, processes
):
    broken = DOUBLE.replace("len(message)", '1 / (message == "env")')
    with double(f"{broken}\nimport time\ntime.sleep(30)") as (_, ask):
        ask("env")
        with pytest.raises(PeerError, match="gave no answer: ZeroDivisionError"):
            ask("physics")
    with double(f"{DOUBLE}\nimport time\ntime.sleep(30)"):
        assert processes[1].poll() is None
    assert processes[1].returncode == -signal.SIGKILL
