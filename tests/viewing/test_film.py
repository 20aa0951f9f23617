"""A film drawn afterwards shows what the environment would have shown."""

import sys
import threading
import typing
from dataclasses import replace

import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.players import EpisodeRecorder
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing import PerformanceRenderer, Picture, View, film, moments

VIEWS = typing.get_args(View)

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")

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
