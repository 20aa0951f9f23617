"""Entries of the page's TypeScript that Python's tests talk to."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

WEB = Path(__file__).parents[2] / "web"


class RefusedInput(Exception):
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
            RefusedInput: If it refuses what it was given.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"No answer to {request.get('ask')!r}: {self._log.read_text()}"
        answer = json.loads(line)
        if "refused" in answer:
            raise RefusedInput(answer["refused"])
        return answer["answer"]

    def close(self) -> None:
        """End the program."""
        self._process.communicate()


@pytest.fixture(scope="session")
def node_tool(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], NodeTool]]:
    """Return the function that bundles and starts ``web/src/tools/<name>.ts``, once for each name."""
    if shutil.which("node") is None or shutil.which("npx") is None:
        pytest.skip("Node.js is not installed: the page's TypeScript cannot run.")
    if not (WEB / "node_modules" / "esbuild").is_dir():
        pytest.skip("The page's packages are not installed: run 'npm ci' in web/.")
    folder = tmp_path_factory.mktemp("web")
    tools: dict[str, NodeTool] = {}

    def start(name: str) -> NodeTool:
        if name not in tools:
            script = folder / f"{name}.mjs"
            options = ["--bundle", "--platform=node", "--format=esm", "--log-level=warning"]
            subprocess.run(
                ["npx", "esbuild", f"src/tools/{name}.ts", *options, f"--outfile={script}"],
                cwd=WEB,
                check=True,
            )
            tools[name] = NodeTool(script, folder / f"{name}.log")
        return tools[name]

    yield start
    for tool in tools.values():
        tool.close()
