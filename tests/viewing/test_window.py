"""The window: on a screen if there is one, with a clear error if not."""

from __future__ import annotations

import os
import time

import numpy as np
import pytest

from sb3_piano.exceptions import RenderingError
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.simulation import compile_scene
from sb3_piano.viewing import FINGER_COLORS, PRESSED_COLOR, Moment, SceneWindow
from sb3_piano.viewing.stage import staged

screen = bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
needs_screen = pytest.mark.skipif(not screen, reason="no screen on this machine")

ROLL = PianoRoll.from_score(Score(notes=[Note(onset=0.5, offset=1.0, pitch=60, finger=1)]), 0.05)


def moment(scene, due=(), fingers=(), sounding=()):
    marked = np.zeros(88, dtype=bool)
    marked[list(sounding)] = True
    return Moment(
        qpos=scene.model.qpos0,
        step=0,
        due=np.array(due, dtype=np.intp),
        fingers=np.array(fingers, dtype=np.int8),
        sounding=marked,
    )


def test_without_a_screen_the_error_says_what_to_do(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(
        RenderingError, match=r"there is no screen .* Expected a screen: .* xvfb-run"
    ):
        SceneWindow(compile_scene(), ROLL)


@pytest.mark.skipif(screen, reason="GLFW keeps the screen it has found once")
def test_a_screen_that_cannot_be_reached_is_an_error_and_no_endless_wait(monkeypatch):
    monkeypatch.setenv("DISPLAY", ":4711")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(RenderingError, match=r"Cannot open a window: .*:4711.* Expected a screen"):
        SceneWindow(compile_scene(), ROLL)


@needs_screen
def test_due_and_sounding_keys_and_fingertips_are_coloured_until_they_no_longer_are():
    scene = compile_scene()
    stage = staged(scene)
    colors = stage.model.geom_rgba.copy()
    with SceneWindow(scene, ROLL) as window:
        shown = window.model.geom_rgba
        window.show(moment(scene, due=[27, 30], fingers=[2, 9], sounding=[30]))
        np.testing.assert_allclose(shown[stage.key_geom[27]], FINGER_COLORS[2], rtol=1e-6)
        np.testing.assert_allclose(shown[stage.key_geom[30]], PRESSED_COLOR, rtol=1e-6)
        np.testing.assert_allclose(shown[stage.fingertip_geom], FINGER_COLORS, rtol=1e-6)
        window.show(moment(scene))
        np.testing.assert_array_equal(shown[stage.key_geom], colors[stage.key_geom])
    np.testing.assert_array_equal(stage.model.geom_rgba, colors)


@needs_screen
def test_a_replay_takes_its_time_and_shows_every_moment():
    scene = compile_scene()
    drawn = []

    def seen():
        for k in range(6):
            drawn.append(k)
            yield moment(scene)

    with SceneWindow(scene, ROLL, view="top") as window:
        start = time.monotonic()
        window.replay(seen(), 0.05)
        assert time.monotonic() - start >= 0.25  # a lower bound only: sleep never ends early
    assert drawn == list(range(6))


@needs_screen
def test_a_replay_ends_when_somebody_closes_the_window():
    scene = compile_scene()
    window = SceneWindow(scene, ROLL)
    drawn = []

    def seen():
        for k in range(100):
            if k == 2:
                window.close()
            drawn.append(k)
            yield moment(scene)

    window.replay(seen(), 0.01)
    assert drawn == [0, 1, 2]
