"""The stage: the joints of the scene, other shapes."""

import mujoco
import numpy as np
import pytest

from sb3_piano.simulation import compile_scene
from sb3_piano.viewing.stage import staged

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
