"""Pictures: what is coloured, and what happens where nothing can be drawn."""

import importlib.util
import os
import pickle
import subprocess
import sys
import textwrap
import threading
import typing
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.players import EpisodeRecorder
from sb3_piano.simulation import compile_scene
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing import PerformanceRenderer, Picture, View, film, moments
from sb3_piano.viewing.frame_renderer import FrameRenderer
from sb3_piano.viewing.moment import FINGER_COLORS, PRESSED_COLOR

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

# A white key beside the left hand, due for the right thumb.
DUE = score_of((0.0, 0.2, 48, 0))


def count_dominated_by(channel, picture):
    """Return how many pixels are clearly red (0), green (1) or blue (2)."""
    others = np.delete(picture.astype(float), channel, axis=2).max(axis=2)
    return int((picture[..., channel] > 1.5 * others).sum())


@pytest.mark.slow
@needs_gl
@pytest.mark.parametrize("view", ["close", "top"])
def test_a_due_key_has_its_fingers_colour_and_keeps_it_in_a_green_rim_while_it_sounds(view):
    env = PianoEnv(DUE, render_mode="rgb_array", view=view, width=640, height=480)
    env.reset(seed=0)
    assert np.argmax(FINGER_COLORS[0][:3]) == 0
    assert np.argmax(PRESSED_COLOR[:3]) == 1
    due = env.render()
    above = slice(0, 450)  # the legend
    assert due.shape == (480, 640, 3)
    assert due.dtype == np.uint8
    assert count_dominated_by(1, due[above]) == 0
    env.data.qpos[env.scene.key_qpos[48 - 21]] = env.scene.key_max_angle[48 - 21]
    pressed = env.render()
    assert count_dominated_by(1, pressed[above]) > 60
    assert count_dominated_by(0, pressed[above]) > 0.5 * count_dominated_by(0, due[above])
    env.close()


@needs_gl
def test_a_renderer_that_is_freed_while_another_draws_changes_nothing_in_its_picture():
    scene = compile_scene()
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    drawing, other = (FrameRenderer(scene, width=64, height=48) for _ in range(2))
    alone = drawing.render(data, {})

    class Freeing(dict):
        def __contains__(self, geom):  # as a garbage collection may do at any moment
            other.close()
            return False

    np.testing.assert_array_equal(drawing.render(data, Freeing()), alone)
    drawing.close()


@needs_gl
def test_a_lean_picture_is_smoother_than_one_sample_a_pixel():
    scene = compile_scene()
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)

    def drawn(scale: int) -> np.ndarray:
        size = {"width": 320 * scale, "height": 240 * scale}
        renderer = FrameRenderer(scene, camera="overview", lean=True, **size)
        picture = renderer.render(data, {}).astype(float)
        renderer.close()
        return picture

    fine = drawn(4)
    smooth = fine.reshape(240, 4, 320, 4, 3).mean(axis=(1, 3))
    error, of_one_sample = (
        np.sqrt(np.square(picture - smooth).mean()) for picture in (drawn(1), fine[1::4, 1::4])
    )
    assert error < 0.8 * of_one_sample


@pytest.mark.slow
@needs_gl
def test_rendering_leaves_everything_as_it_was_and_a_copy_draws_the_same():
    env = PianoEnv(DUE, render_mode="rgb_array", width=64, height=64)
    env.reset(seed=0)
    colors, before = env.model.geom_rgba.copy(), env.get_state().physics
    picture = env.render()
    np.testing.assert_array_equal(env.model.geom_rgba, colors)
    np.testing.assert_array_equal(env.get_state().physics, before)
    rows = picture[..., 2].mean(axis=1)
    assert rows[:20].max() < 60 < rows[32:].max()  # upright: keys are below the panel
    twin = pickle.loads(pickle.dumps(env))
    off = np.abs(twin.render().astype(int) - picture)
    assert off.max() < 10, "but for rounding at edges"
    assert (off > 0).mean() < 0.005
    np.testing.assert_array_equal(env.render(), picture)
    for each in (twin, env, env):
        each.close()


NO_OPENGL = """
from sb3_piano.envs import PianoEnv
env = PianoEnv("TwinkleTwinkleLittleStar", render_mode="rgb_array")
env.reset(seed=0)
env.step(env.rest_action)
print("stepped")
try:
    env.render()
except Exception as error:
    print(type(error).__name__, error)
"""


WITHOUT_LIBRARIES = "import ctypes.util\nctypes.util.find_library = lambda name: None\n"

# As it ends where libOSMesa is missing, which ends MuJoCo's import, too.
BROKEN_LIBRARY = """
import sys
class Missing:
    def find_spec(self, name, *where):
        if name == "OpenGL":
            raise AttributeError("no glGetError")
sys.meta_path.insert(0, Missing())
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("prelude", "variables", "reason"),
    [
        ("", {"MUJOCO_GL": "nonsense"}, ": MUJOCO_GL is 'nonsense'"),
        (WITHOUT_LIBRARIES, {}, ": no OpenGL library was found"),
        (BROKEN_LIBRARY, {"MUJOCO_GL": "osmesa"}, " with the OpenGL backend 'osmesa' (no glGetErr"),
        ("", {"MUJOCO_GL": "glfw"}, " with the OpenGL backend 'glfw' ((65550)"),
    ],
)
def test_where_nothing_can_be_drawn_the_env_still_steps_and_says_what_to_install(
    prelude, variables, reason
):
    hidden = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {k: v for k, v in os.environ.items() if k not in hidden} | variables
    command = [sys.executable, "-W", "error", "-c", prelude + NO_OPENGL]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert done.stdout.startswith(f"stepped\nRenderingError Cannot draw the scene{reason}")
    assert done.stdout.count("\n") == 2
    assert "apt-get install libosmesa6" in done.stdout


@needs_gl
@pytest.mark.skipif(
    importlib.util.find_spec("triton") is None, reason="torch's build has no triton"
)
def test_an_optimiser_can_be_made_after_a_picture():
    program = """
        import gymnasium
        import sb3_piano
        env = gymnasium.make("RoboPianist-v0", render_mode="rgb_array")
        env.reset()
        env.render()
        import torch
        torch.optim.Adam([torch.zeros(1, requires_grad=True)])
    """
    subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=True)


# A film drawn afterwards shows what the environment would have shown.


VIEWS = typing.get_args(View)


PIECE = score_of((0.0, 0.1, 48, 0), (0.1, 0.2, 60))


def episode(**options):
    """Play PIECE with hands that press keys; return env, recording and the rendered pictures."""
    env = EpisodeRecorder(PianoEnv(PIECE, **options))
    env.reset(seed=0)
    action = np.where(np.arange(39) % 2 == 0, 0.9, -0.3).astype(np.float32)
    pictures, over = [env.render()], False
    while not over:
        _, _, _, over, _ = env.step(action)
        pictures.append(env.render())
    return env.unwrapped, env.finished[0], pictures


@pytest.mark.slow
@needs_gl
@pytest.mark.parametrize("view", VIEWS)
def test_every_picture_is_that_of_the_environments_render(view):
    env, recording, rendered = episode(render_mode="rgb_array", view=view, width=288, height=162)
    drawn = list(film(recording, Picture(width=288, height=162, view=view, fps=20)))
    env.close()
    assert recording.performance.key_active.any()
    assert len(drawn) == len(rendered) == len(env.roll) + 1
    # Drawing contexts may round a few pixels differently.
    np.testing.assert_allclose(drawn, np.asarray(rendered, float), atol=9)


def test_moments_have_the_keys_that_are_due_and_those_that_sound():
    env, recording, _ = episode()
    take = recording
    seen = list(moments(take))
    # At first the keys of the first step are due, later those of the step just played.
    assert [moment.due.tolist() for moment in seen] == [[27], [27], [27], [39], [39], []]
    assert [moment.fingers.tolist() for moment in seen] == [[0], [0], [0], [-1], [-1], []]
    shown = np.array([moment.sounding for moment in seen])
    assert shown.any()
    assert not shown[0].any()
    np.testing.assert_array_equal(shown[1:], recording.performance.key_active)
    assert [moment.step for moment in seen] == list(range(len(env.roll) + 1))
    assert seen[0].f1 is None
    assert seen[-1].f1 == pytest.approx(recording.metrics["f1"])
    between = list(moments(take, fps=60))
    assert len(between) == 3 * len(seen)
    np.testing.assert_allclose(between[4].qpos, (2 * seen[1].qpos + seen[2].qpos) / 3)
    assert [moment.due.tolist() for moment in between[6:10]] == [[27], [39], [39], [39]]
    assert (between[-1].qpos == seen[-1].qpos).all(), "the last state stays for one step"
    unmarked = list(moments(replace(take, judged=False)))
    assert all(moment.sounding is None for moment in unmarked)
    assert all(moment.f1 is None for moment in unmarked)


@pytest.mark.slow
@needs_gl
def test_a_film_frees_its_drawing_contexts_also_if_it_is_not_watched_to_the_end(monkeypatch):
    opened, closed = [], []

    class Renderer(PerformanceRenderer):
        def __init__(self, *scene, **options):
            super().__init__(*scene, **options)
            opened.append(self)

        def close(self):
            closed.append(self)
            super().close()

    monkeypatch.setattr(sys.modules[film.__module__], "PerformanceRenderer", Renderer)
    env, recording, _ = episode()
    for watched in (2, len(env.roll) + 1):
        before = threading.active_count()
        frames = film(recording, Picture(width=64, height=64, fps=20))
        for _ in range(watched):
            assert next(frames).shape == (64, 64, 3)
        frames.close()
        assert threading.active_count() == before
    assert set(closed) == set(opened)
