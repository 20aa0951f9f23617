"""Views: what the camera has in sight, and in which colours."""

import itertools
import math
import typing

import mujoco
import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.cli.play import VIEWS
from sb3_piano.envs import PianoEnv
from sb3_piano.simulation import compile_scene
from sb3_piano.simulation.gl import find_gl_backend
from sb3_piano.viewing import View
from sb3_piano.viewing.moment import (
    FINGER_COLORS,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    WRONG_COLOR,
    geom_colors,
)
from sb3_piano.viewing.note_bars import Stretch
from sb3_piano.viewing.stage import FIELD_OF_VIEW
from sb3_piano.viewing.views import SHOTS, place_camera

needs_gl = pytest.mark.skipif(find_gl_backend() is None, reason="no OpenGL library on this machine")


def test_the_command_knows_all_views():
    assert typing.get_args(View) == VIEWS


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("aspect", [0.5, 16 / 9, 8.0])
def test_the_keys_are_in_the_middle_and_within_the_width_of_the_picture(view, aspect):
    camera = mujoco.MjvCamera()
    for width in (0.25, 1.2):
        place_camera(camera, SHOTS[view], Stretch(middle=-0.3, width=width), aspect)
        height = 2 * camera.distance * math.tan(math.radians(FIELD_OF_VIEW / 2))
        assert camera.lookat[1] == -0.3
        assert height * aspect > width + 0.1
        assert height > 0.2  # of a flat picture, too


def test_close_goes_along_and_two_views_have_room_for_notes():
    assert [view for view in VIEWS if SHOTS[view].follows] == ["close"]
    assert [view for view in VIEWS if SHOTS[view].foot is not None] == ["stage", "roll"]


def test_a_key_that_sounds_is_green_or_red_where_right_and_wrong_are_told_apart():
    scene = compile_scene()
    asked = {"due": np.array([10, 20]), "fingers": np.array([1, -1])}
    sounding = np.zeros(88, dtype=bool)
    sounding[[20, 30]] = True
    colors = geom_colors(scene, **asked, sounding=sounding)
    expected = [FINGER_COLORS[1], PRESSED_COLOR, WRONG_COLOR]
    assert [colors[scene.key_geom[key]] for key in (10, 20, 30)] == expected
    colors = geom_colors(scene, **asked, sounding=None)
    assert colors[scene.key_geom[20]] == UNLABELLED_COLOR
    assert scene.key_geom[30] not in colors


@pytest.mark.slow
@needs_gl
def test_each_view_is_another_picture():
    score = score_of((0.0, 0.2, 60, 0))
    pictures = []
    for view in VIEWS:
        env = PianoEnv(score, render_mode="rgb_array", view=view, width=160, height=90)
        env.reset(seed=0)
        pictures.append(env.render().astype(int))
        env.close()
    for one, other in itertools.combinations(pictures, 2):
        assert np.abs(one - other).mean() > 5
