"""The sdist and the wheel hold what is tracked, and the wheel works without anything beside it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]

USE = """
import gymnasium
import sb3_piano
from sb3_piano.training import load_config

env = gymnasium.make("RoboPianist-repertoire-FurElise-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
gymnasium.make("RoboPianist-encore-GriegArietta-v0").reset(seed=0)
load_config("sac", "RoboPianist-repertoire-FurElise-v0")
print(sb3_piano.__file__)
"""


def run(*command: object, **options) -> str:
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def tracked() -> set[str]:
    if not (ROOT / ".git").exists():
        pytest.skip("only a checkout knows which files are tracked")
    return set(run("git", "-C", ROOT, "ls-files", "-z").split("\0")) - {""}


REPLAY = "sb3_piano/viewing/report/templates/replay.js"
"""What `make replay` builds."""


@pytest.fixture(scope="module")
def built(tracked, tmp_path_factory) -> Path:
    """Build the sdist from the tracked files and the replay, and the wheel from the sdist."""
    source, dist = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("dist")
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    (source / REPLAY).write_text("// as built", encoding="utf-8")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, source)
    return dist


@pytest.mark.slow
def test_the_sdist_holds_every_tracked_file(built, tracked):
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert tracked - names == set()


def test_the_wheel_holds_the_packages_tracked_files_and_the_replay_and_is_small(built, tracked):
    (wheel,) = built.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert names == {REPLAY, *(name for name in tracked if name.startswith("sb3_piano/"))}
    assert wheel.stat().st_size < 15e6


@pytest.mark.slow
def test_the_installed_wheel_makes_an_env_and_loads_a_preset(built, tmp_path):
    (wheel,) = built.glob("*.whl")
    site = tmp_path / "site"
    run(
        sys.executable, "-m", "pip", "install", "--no-deps", "--no-compile", "--target", site, wheel
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    imported = run(sys.executable, "-c", USE, cwd=elsewhere, env=os.environ | {"PYTHONPATH": site})
    assert Path(imported.strip()) == site / "sb3_piano" / "__init__.py"


def test_type_checkers_find_an_editable_install():
    """They follow a path, and no finder, which setuptools would write for this layout."""
    installed = Path(sysconfig.get_path("purelib"))
    assert not [*installed.glob("__editable__*sb3_piano*finder.py")]
