"""A hand as data: found by name or path, checked, and the only place that knows its joints."""

import pickle
import re
import shutil
from pathlib import Path

import pytest
from yaml_rows import Tables

import sb3_piano
from sb3_piano.exceptions import ConfigError
from sb3_piano.hands import find_hand
from sb3_piano.simulation import compile_scene

tables = Tables(__file__)
PACKAGE = Path(sb3_piano.__file__).parent
ROOT = Path(__file__).parents[2]
JOINTS = re.compile(r"WRJ|[FMRL]FJ\d|THJ|forearm_t[xyz]")
SHADOW = PACKAGE / "hands" / "shadow"


@pytest.fixture
def own_hand(tmp_path):
    """Return a folder with a copy of the Shadow hand, to be changed."""
    return Path(shutil.copytree(SHADOW, tmp_path / "my_hand"))


def change(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_names_of_joints_occur_in_the_folders_of_hands_only():
    sources = [p for p in PACKAGE.rglob("*") if p.suffix in (".py", ".yml", ".json", ".xml")]
    sources += [*(ROOT / "web" / "src").rglob("*.ts")]
    named = [path for path in sources if JOINTS.search(path.read_text(encoding="utf-8"))]
    assert {path.parent for path in named} == {SHADOW}


def test_a_name_that_is_unknown_is_answered_with_a_near_one():
    with pytest.raises(ConfigError, match=r"hand is 'shado'.*'shadow'"):
        find_hand("shado")


def test_a_hand_from_elsewhere_is_found_by_its_path_also_after_pickling(own_hand):
    found = find_hand(own_hand)
    assert (found.source, found.folder) == (str(own_hand), own_hand)
    assert pickle.loads(pickle.dumps(found)) is found
    assert compile_scene(hand=str(own_hand)).options["hand"] == str(own_hand)


def test_roles_are_those_of_hand_yml():
    hand = find_hand()
    names = ("forearm_tx", "forearm_ty", "WRJ1", "FFJ4", "THJ4", "FFJ3")
    roles = ["along", "across", "wrist", "abduction", "finger", "finger"]
    assert [hand.role(name) for name in names] == roles
    assert hand.short("lh_shadow_hand/lh_A_FFJ0") == "FFJ0"


@tables("old, new, message")
def test_what_is_wrong_in_hand_yml_is_told_with_its_path(own_hand, old, new, message):
    change(own_hand / "hand.yml", old, new)
    with pytest.raises(ConfigError, match=message) as caught:
        find_hand(own_hand)
    assert str(own_hand / "hand.yml") in str(caught.value)


@tables("old, new, message")
def test_what_the_model_lacks_is_told_by_its_role(own_hand, old, new, message):
    change(own_hand / "hand.yml", old, new)
    with pytest.raises(ConfigError, match=message):
        compile_scene(hand=str(own_hand))


def test_each_side_s_model_has_a_name_of_its_own(own_hand):
    change(own_hand / "left.xml", 'model="lh_shadow_hand"', 'model="rh_shadow_hand"')
    with pytest.raises(ConfigError, match="left hand of .* begins with 'lh_'"):
        compile_scene(hand=str(own_hand))


def test_joints_that_kinematics_does_not_know_are_refused(own_hand):
    change(own_hand / "right.xml", '<joint name="rh_WRJ1"', '<joint name="rh_WRJ1" pos="0 0 0.01"')
    with pytest.raises(ConfigError, match="joints of 'rh_palm'.*then hinges, at the body's origin"):
        compile_scene(hand=str(own_hand))


def test_a_file_that_is_no_mjcf_is_told_with_its_path(own_hand):
    (own_hand / "left.xml").write_text("<mujoco><worldbody></mujoco>")
    with pytest.raises(ConfigError, match=r"left\.xml' is no hand"):
        compile_scene(hand=str(own_hand))
