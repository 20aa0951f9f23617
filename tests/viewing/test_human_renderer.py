"""The window: on a screen if there is one, with a clear error if not."""

import json
import os
import shutil
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

from sb3_piano.exceptions import RenderingError
from sb3_piano.simulation import compile_scene
from sb3_piano.viewing.moment import FINGER_COLORS, PRESSED_COLOR
from sb3_piano.viewing.stage import staged

PROGRAM = """
import copy
import json
import time

import gymnasium as gym
import numpy as np

from sb3_piano.exceptions import RenderingError
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.simulation import compile_scene
from sb3_piano.training.playing.takes import take_of_score
from sb3_piano.take import show_take
from sb3_piano.viewing.human_renderer import HumanRenderer
from sb3_piano.viewing.moment import Moment
from sb3_piano.viewing.stage import staged

score = Score(notes=[Note(onset=0.1, offset=0.3, pitch=60, finger=1)])
env = gym.make("RoboPianist-v0", score=score, physics="fast", render_mode="human")
env.reset(seed=0)
window = env.unwrapped._renderer
opened, positions, start, over = window.is_running, [], time.monotonic(), False
while not over:
    *_, over, _ = env.step(env.unwrapped.rest_action)
    positions.append(bool((window._data.qpos == env.unwrapped.data.qpos).all()))
seconds = time.monotonic() - start
returned = env.render()
copied = copy.deepcopy(env)
copied.reset(seed=0)
try:
    HumanRenderer(compile_scene(), fps=20)
except RenderingError as error:
    second = str(error)
env.close()
shown = {
    "env": [opened, window.is_running, returned, seconds / (len(positions) - 1), all(positions)],
    "others": [copied.render(), second],
}

take = take_of_score(score)
start = time.monotonic()
show_take(take)
shown["take"] = (time.monotonic() - start) / (len(take.qpos) - 1)

scene = compile_scene()
window = HumanRenderer(scene, fps=20, view="top")


def colors(due=(), fingers=(), sounding=()):
    marked = np.zeros(88, dtype=bool)
    marked[list(sounding)] = True
    due, fingers = np.array(due, dtype=np.intp), np.array(fingers, dtype=np.int8)
    moment = Moment(qpos=scene.model.qpos0, step=0, due=due, fingers=fingers, sounding=marked)
    window.render(PianoRoll.from_score(score, 0.05), "", moment)
    return window.model.geom_rgba.tolist()


shown["marked"] = colors(due=[27, 30], fingers=[2, 9], sounding=[30])
shown["after"] = colors()
window.close()
shown["closed"] = colors(due=[27], fingers=[2])
shown["stage"] = staged(scene).model.geom_rgba.tolist()
HumanRenderer(scene, fps=20)  # which nobody closes
print(json.dumps(shown))
"""


def run_python(program):
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)


@pytest.fixture(scope="module")
def screen():
    """A virtual screen, by the name that DISPLAY has."""
    if shutil.which("Xvfb") is None:
        pytest.skip("there is no Xvfb on this machine")
    reading, writing = os.pipe()
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(command, pass_fds=[writing], **quiet)
    os.close(writing)
    with os.fdopen(reading) as told:
        number = told.readline().strip()
    yield f":{number}"
    server.terminate()
    server.wait()


@pytest.fixture
def no_screen(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    return monkeypatch


def test_without_a_screen_the_error_says_what_to_do(no_screen):
    env = gym.make("RoboPianist-debug-CMajorScaleOneHand-v0", render_mode="human")
    with pytest.raises(
        RenderingError, match=r"there is no screen .* Expected a screen: .* xvfb-run"
    ):
        env.reset(seed=0)


@pytest.mark.slow
def test_a_screen_that_cannot_be_reached_is_an_error_and_no_endless_wait(no_screen):
    no_screen.setenv("DISPLAY", ":4711")
    done = run_python("from sb3_piano.viewing.human_renderer import check_screen\ncheck_screen()")
    for text in ("RenderingError: Cannot open a window: ", ":4711", "Expected a screen"):
        assert text in done.stderr


@pytest.fixture(scope="module")
def shown(screen):
    """Return what a program shows; GLFW keeps the first screen that a process finds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", screen)
        patch.delenv("MUJOCO_GL", raising=False)
        done = run_python(PROGRAM)
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


@pytest.mark.slow
def test_environments_and_takes_are_shown_in_real_time_in_one_window_until_it_is_closed(shown):
    opened, still_open, returned, period, same_positions = shown["env"]
    assert (opened, still_open, returned, same_positions) == (True, False, None, True)
    assert period >= 0.05 * 0.999  # a lower bound only: sleep never ends early
    assert shown["take"] >= 0.05
    of_a_copy, told = shown["others"]
    assert of_a_copy is None
    assert told.startswith("Cannot open a window: another one is open. Expected one environment")


@pytest.mark.slow
def test_due_and_sounding_keys_and_fingertips_are_coloured_until_they_no_longer_are(shown):
    stage = staged(compile_scene())
    marked, after = np.array(shown["marked"]), np.array(shown["after"])
    np.testing.assert_allclose(marked[stage.key_geom[27]], FINGER_COLORS[2], rtol=1e-6)
    np.testing.assert_allclose(marked[stage.key_geom[30]], PRESSED_COLOR, rtol=1e-6)
    np.testing.assert_allclose(marked[stage.fingertip_geom], FINGER_COLORS, rtol=1e-6)
    np.testing.assert_array_equal(after[stage.key_geom], stage.model.geom_rgba[stage.key_geom])
    assert shown["closed"] == shown["after"]  # nobody sees more
    np.testing.assert_array_equal(shown["stage"], stage.model.geom_rgba)
