"""Programs of the page's TypeScript that answer lines of JSON with lines of JSON."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

WEB = Path(__file__).parents[3] / "web"


class RefusedInputError(Exception):
    """The page refused its input; the text is what it tells its reader."""


class NodeTool:
    """A program that answers a line of JSON with a line of JSON."""

    def __init__(self, script: Path, log: Path) -> None:
        self._log = log
        with log.open("w") as complaints:
            self._process = subprocess.Popen(
                ["node", str(script)],
                cwd=WEB,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=complaints,
                text=True,
            )

    def ask(self, request: dict[str, Any]) -> Any:
        """Return what the program answers to a request.

        Raises:
            RefusedInputError: If it refuses what it was given.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"No answer to {request.get('ask')!r}: {self._log.read_text()}"
        answer = json.loads(line)
        if "refused" in answer:
            raise RefusedInputError(answer["refused"])
        return answer["answer"]

    def close(self) -> None:
        """End the program."""
        self._process.communicate()
