"""What is said where DeepMind's libraries are missing, and how they are imported."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

ABSENT = "import sys; sys.modules[{!r}] = None; from sb3_piano.interop import scene_mjcf; "


def last_line_of_failure(program):
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 1
    return done.stderr.strip().splitlines()[-1]


def test_without_dm_env_the_room_says_what_to_install():
    line = last_line_of_failure(ABSENT.format("dm_env"))
    assert line.startswith("ImportError: sb3_piano.interop needs dm_env")
    assert line.endswith("pip install dm-env")


def test_without_dm_control_the_scene_says_what_to_install_and_on_which_python():
    pytest.importorskip("dm_env")
    line = last_line_of_failure(ABSENT.format("dm_control") + "scene_mjcf()")
    assert "pip install 'dm-control>=1.0.50'" in line
    assert "Python 3.11 or 3.12" in line


def test_dm_control_is_imported_without_a_screen_and_the_environment_stays_as_it_was():
    pytest.importorskip("dm_control")
    program = """
import os
from sb3_piano.interop import scene_mjcf
scene_mjcf()
assert "MUJOCO_GL" not in os.environ
"""
    hidden = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    command = [sys.executable, "-W", "error", "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
