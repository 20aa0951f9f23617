"""A left hand that has no file: the right one in a mirror."""

import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

import sb3_piano
from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import find_hand
from sb3_piano.hands.kinematics import HandKinematics
from sb3_piano.simulation import compile_scene

SHADOW = Path(sb3_piano.__file__).parent / "hands" / "shadow"
MIRROR = np.array([1.0, -1.0, 1.0])
FOREARMS = pytest.mark.parametrize(
    "dofs", [None, tuple(find_hand().forearm.joints.values())], ids=["sliders", "all"]
)


@pytest.fixture
def one_file(tmp_path):
    """Return a folder with the right Shadow hand alone."""
    folder = Path(shutil.copytree(SHADOW, tmp_path / "my_hand"))
    (folder / "left.xml").unlink()
    return folder


@FOREARMS
def test_its_fingertips_are_those_of_the_right_hand_in_the_mirror(one_file, dofs):
    scene = compile_scene(hand=str(one_file), forearm_dofs=dofs)
    right, left = HandKinematics(scene, 0), HandKinematics(scene, 1)
    positions = np.random.default_rng(0).uniform(right.low, right.high, (20, right.size))
    mirrored = positions.copy()
    # It still slides to the right, and rolls as the right one does.
    mirrored[:, np.isin(left.roles, ("along", "roll"))] *= -1
    tips = right.fingertips(positions) * MIRROR
    np.testing.assert_allclose(left.fingertips(mirrored), tips, atol=1e-12)
    np.testing.assert_array_equal(left.high[left.along], -right.low[right.along])


@FOREARMS
def test_it_moves_and_touches_as_the_left_hand_with_a_file_of_its_own_does(one_file, dofs):
    """The left Shadow hand has a file, of which a box of the palm alone is not a mirror image."""
    shipped = compile_scene(forearm_dofs=dofs)
    mirrored = compile_scene(hand=str(one_file), forearm_dofs=dofs)
    controls = np.random.default_rng(1).uniform(shipped.ctrl_low, shipped.ctrl_high)
    ends = []
    for scene in (shipped, mirrored):
        data = mujoco.MjData(scene.model)
        data.ctrl[:] = controls
        mujoco.mj_step(scene.model, data, 60)
        ends.append(scene.fingertip_position(data))
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-3)


def test_orientations_that_are_not_mirrored_are_refused(one_file):
    file = one_file / "right.xml"
    text = file.read_text()
    place = 'pos="0.4 0.15 0.13" quat="-0.5 -0.5 0.5 0.5"'
    assert place in text
    file.write_text(text.replace(place, 'pos="0.4 0.15 0.13" euler="0 0 1"'))
    with pytest.raises(ConfigError, match="written with quat or fromto"):
        compile_scene(hand=str(one_file))
