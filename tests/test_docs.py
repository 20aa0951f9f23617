"""What the README and the examples tell their readers to run does run."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from sb3_piano.cli import main
from sb3_piano.envs import ENV_IDS
from sb3_piano.training import load_config
from sb3_piano.training.builders import build_callbacks

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = {
    f"{page.name} {number}": block
    for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
    for number, block in enumerate(
        re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    )
}
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def run(code: list[str], folder: Path) -> str:
    one_thread = {**os.environ, "OMP_NUM_THREADS": "1"}  # faster for such small networks
    command = [sys.executable, *code]
    done = subprocess.run(command, cwd=folder, env=one_thread, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("block", BLOCKS)
def test_a_python_block_runs(block, tmp_path):
    run(["-c", BLOCKS[block]], tmp_path)


def test_the_readme_has_python_blocks_and_names_every_environment():
    assert {"README.md 0", "README.md 1"} <= set(BLOCKS)
    assert all(f"`{env_id}`" in README for env_id in ENV_IDS)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_prints_a_number(example, tmp_path):
    assert re.search(r"\d", run([str(example)], tmp_path))


def test_the_demo_of_the_makefile_trains_and_evaluates(tmp_path, monkeypatch, capsys):
    command = re.search(r"^\t\$\(BIN\)/sb3-piano (.*)$", MAKEFILE, re.MULTILINE)[1].split()
    monkeypatch.chdir(ROOT)
    command.remove("--play")  # drawing takes long without a graphics card
    shortened = [*command, "--steps", "200", "--runs-dir", str(tmp_path), "--no-progress"]
    assert main(shortened) == 0
    assert "non-silent F1" in capsys.readouterr().out


@pytest.mark.parametrize(("name", "algo"), [("demo", "sac"), ("callbacks", "td3")])
def test_a_yaml_file_of_the_examples_has_valid_settings(name, algo):
    file = ROOT / "examples" / f"{name}.yml"
    (env_id,) = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert build_callbacks(load_config(algo, env_id, file))
