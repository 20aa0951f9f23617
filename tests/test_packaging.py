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


REPLAY = "sb3_piano/viewing/report/templates/replay.js"
"""What `make replay` builds."""


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="only a checkout knows what is tracked")
def test_sdist_and_wheel_hold_what_is_tracked_and_the_wheel_makes_an_env_and_loads_a_preset(
    tmp_path,
):
    """The sdist is built from the tracked files and the replay, and the wheel from the sdist."""
    tracked = set(run("git", "-C", ROOT, "ls-files", "-z").split("\0")) - {""}
    source, dist, site = (tmp_path / name for name in ("source", "dist", "site"))
    for name in tracked:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    (source / REPLAY).write_text("// as built", encoding="utf-8")
    run(sys.executable, "-m", "build", "--no-isolation", "--outdir", dist, source)
    with tarfile.open(*dist.glob("*.tar.gz")) as archive:
        assert tracked <= {name.partition("/")[2] for name in archive.getnames()}
    (wheel,) = dist.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        archive.extractall(site)  # as pip does
    assert names == {REPLAY, *(name for name in tracked if name.startswith("sb3_piano/"))}
    assert wheel.stat().st_size < 15e6
    imported = run(sys.executable, "-c", USE, cwd=tmp_path, env=os.environ | {"PYTHONPATH": site})
    assert Path(imported.strip()) == site / "sb3_piano" / "__init__.py"


def test_type_checkers_find_an_editable_install():
    """They follow a path, and no finder, which setuptools would write for this layout."""
    installed = Path(sysconfig.get_path("purelib"))
    assert not [*installed.glob("__editable__*sb3_piano*finder.py")]
