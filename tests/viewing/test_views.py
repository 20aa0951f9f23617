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
from sb3_piano.viewing.caption import write_caption
from sb3_piano.viewing.moment import (
    FINGER_COLORS,
    PRESSED_COLOR,
    UNLABELLED_COLOR,
    WRONG_COLOR,
    geom_colors,
)
from sb3_piano.viewing.note_bars import Stretch
from sb3_piano.viewing.stage import FIELD_OF_VIEW, staged
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


# The stage: the joints of the scene, other shapes.


OPTIONS = [
    {},
    {"reduced_action_space": False},
    {"sides": ("left",)},
    {"sides": ()},
    {"moving_keys": (30, 50)},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_joint_positions_of_the_scene_are_those_of_the_stage(options):
    scene = compile_scene(**options)
    stage = staged(scene)
    generator = np.random.default_rng(0)
    joints = scene.model.jnt_range
    qpos = generator.uniform(joints[:, 0], joints[:, 1])
    places = []
    for model in (scene.model, stage.model):
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        places.append((data.xpos.copy(), data.xquat.copy()))
    np.testing.assert_array_equal(*[xpos for xpos, _ in places])
    np.testing.assert_array_equal(*[xquat for _, xquat in places])
    assert stage.sides == scene.sides
    np.testing.assert_array_equal(stage.key_slice, scene.key_slice)


def test_equal_scenes_share_a_stage_and_the_scene_has_none_of_its_shapes():
    scene = compile_scene()
    shapes = scene.model.ngeom
    assert staged(scene) is staged(scene.copy())
    assert staged(scene).model.ngeom > shapes
    assert scene.model.ngeom == compile_scene().model.ngeom == shapes


def test_what_is_added_meets_nothing_and_covers_what_it_hides():
    scene = compile_scene(reduced_action_space=False)
    stage = staged(scene)
    model = stage.model
    names = {scene.model.geom(i).name for i in range(scene.model.ngeom)}
    added = [i for i in range(model.ngeom) if model.geom(i).name not in names]
    assert added
    assert not model.geom_contype[added].any()
    assert not model.geom_conaffinity[added].any()
    hidden = {model.geom_bodyid[i] for i in range(model.ngeom) if model.geom_rgba[i, 3] == 0}
    seen = {model.geom_bodyid[i] for i in range(model.ngeom) if model.geom_rgba[i, 3] > 0}
    bare = {model.body(body).name.rpartition("_")[2] for body in hidden - seen}
    # Small parts that lie within the shapes of their neighbours.
    assert bare == {"wrist", "ffknuckle", "mfknuckle", "rfknuckle", "lfknuckle", "thhub"}


# Captions on pictures.


def written(title, f1=None, shape=(480, 854, 3)):
    picture = np.zeros(shape, dtype=np.uint8)
    write_caption(picture, title, f1)
    return picture


def columns(picture):
    """Return the columns in which something is written."""
    return np.flatnonzero(picture.any(axis=(0, 2)))


def test_the_title_is_on_the_left_the_f1_on_the_right_and_the_rest_as_it_was():
    title = columns(written("Für Elise"))
    assert 5 < title.min() < title.max() < 427
    both = columns(written("Für Elise", 0.93))
    assert both.max() > 800
    assert (written("Für Elise", 0.931) == written("Für Elise", 0.929)).all()
    assert (written("Für Elise", 0.93) != written("Für Elise", 0.91)).any()
    assert not written("Für Elise", 0.93)[60:].any()


def test_a_long_title_is_shortened_to_half_of_the_width_and_what_does_not_fit_is_left_out():
    long = columns(written("Sonata quasi una fantasia " * 5))
    assert 300 < long.max() < 450
    assert not written("Für Elise", shape=(480, 16, 3)).any()
    assert not written("Für Elise", 0.93, shape=(120, 200, 3)).any()


def test_letters_of_other_languages_are_drawn_and_not_replaced():
    shapes = {written(letter)[:60, :60].tobytes() for letter in "üřžçñß\u0e01"}
    assert len(shapes) == 7


def test_the_legend_is_at_the_foot_and_the_lamp_of_the_pedal_lights_up():
    up, down = (np.zeros((480, 854, 3), dtype=np.uint8) for _ in range(2))
    write_caption(up, "", None, pedal=False)
    write_caption(down, "", None, pedal=True)
    assert not up[:440].any()
    assert len(columns(up)) > 500
    lamp = np.argwhere((up != down).any(axis=2))
    assert len(lamp) > 50
    assert lamp[:, 1].min() > 750
