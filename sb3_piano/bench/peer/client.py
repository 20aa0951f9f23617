"""Our side: starts the interpreter that has RoboPianist, and tells it when to play."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from sb3_piano.bench.rounds import Lap
from sb3_piano.bench.settings import ENV_ID
from sb3_piano.exceptions import SB3PianoError

VERSION = "1.0.10"
"""The RoboPianist that is compared with."""

INSTALL = (
    f'pip install robopianist=={VERSION} "mujoco==3.17.*" "numpy<2" "pandas<2.3" "scipy<1.14" '
    '"contourpy<1.3" scikit-learn==1.4.2'
)
"""How to install it so that it runs with the MuJoCo that this package is tested with."""

_SCRIPT = Path(__file__).with_name("script.py")


class PeerError(SB3PianoError, RuntimeError):
    """RoboPianist cannot be started in the given interpreter, or stopped answering."""


class Peer:
    """RoboPianist in a process that waits until it is told to play.

    A context manager; the process ends with it, and also when this process dies.

    Args:
        python: The interpreter that has RoboPianist.
        actions: (steps, 39) float32, what it plays each time.
        script: What that interpreter runs.

    Raises:
        PeerError: If there is no such interpreter, or it has no RoboPianist of :data:`VERSION`.
    """

    def __init__(
        self, python: str, actions: npt.NDArray[np.float32], script: Path = _SCRIPT
    ) -> None:
        self._python = python
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        try:
            # In a session of its own it does not hear Ctrl-C, which is for us to answer.
            self._process = subprocess.Popen(
                [python, str(script)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                text=True,
                start_new_session=True,
            )
        except OSError as error:
            self._stderr.close()
            raise self._error(f"cannot be started: {error.strerror}") from error
        try:
            self.versions = self._start(actions)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Peer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def play(self, what: str) -> Lap:
        """Let it play an episode, and wait for its end.

        Args:
            what: ``env`` for its environment, ``physics`` for the bare MuJoCo under it.

        Raises:
            PeerError: If it fails.
        """
        answer = self._ask({"play": what})
        return Lap(steps=int(answer["steps"]), seconds=float(answer["seconds"]))

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()
        self._stderr.close()

    def _start(self, actions: npt.NDArray[np.float32]) -> Mapping[str, str]:
        versions: dict[str, str] = self._ask({"env_id": ENV_ID, "actions": actions.tolist()})
        if versions.get("robopianist") != VERSION:
            raise self._error(f"has robopianist {versions.get('robopianist')}, not {VERSION}")
        return versions

    def _ask(self, message: Mapping[str, Any]) -> dict[str, Any]:
        """Send one line of JSON and return the one that answers it."""
        assert self._process.stdin is not None, "the pipe was asked for"
        assert self._process.stdout is not None, "the pipe was asked for"
        try:
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            raise self._error(f"ended without an answer: {self._last_words()}")
        try:
            answer = json.loads(line)
        except json.JSONDecodeError:
            answer = None
        if not isinstance(answer, dict):
            raise self._error(f"answered {line.strip()[:60]!r}, which this command did not expect")
        if "error" in answer:
            raise self._error(f"cannot run RoboPianist: {answer['error']}")
        return answer

    def _last_words(self) -> str:
        self._process.wait()
        self._stderr.seek(0)
        lines = self._stderr.read().decode(errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "no error told")

    def _error(self, what: str) -> PeerError:
        return PeerError(
            f"The peer interpreter '{self._python}' {what}. Expected the Python of an environment "
            f"made with: {INSTALL}"
        )
