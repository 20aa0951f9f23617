"""Entries of the page's TypeScript that Python's tests talk to."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator

import pytest
from node_programs import WEB, NodeTool


@pytest.fixture(scope="session")
def node_tool(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], NodeTool]]:
    """Return what bundles and starts ``web/src/tools/<name>.ts``, once for each name."""
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
