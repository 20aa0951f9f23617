"""A hand from outside the package, with four fingers and without a wrist, plays as others do."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.envs import PianoEnv
from sb3_piano.music.fingering.robot import release_early
from sb3_piano.players import make_player
from sb3_piano.players.rollout import rollout
from sb3_piano.take import Take

LEAP = Path(__file__).parents[2] / "examples" / "leap_hand"
C4 = 60


def five_fingers():
    """Return five notes, one after the other, for the five fingers of a pianist's right hand."""
    pitches = (C4, C4 + 2, C4 + 4, C4 + 5, C4 + 7)
    return score_of(*((0.4 * i, 0.4 * i + 0.35, p, i) for i, p in enumerate(pitches)))


def leap_env(**options):
    return PianoEnv(five_fingers(), **{"hand": LEAP, "hands_in_scene": "right", **options})


@pytest.mark.parametrize("fingering", ["keep", "ergonomic", "robot"])
def test_notes_of_a_finger_that_it_lacks_get_others(fingering):
    env = leap_env(fingering=fingering)
    assert env.scene.fingers.tolist() == [0, 1, 2, 3]
    assert {note.finger for note in env.score.notes} == {0, 1, 2, 3}
    assert env.reset(options={"score": five_fingers()})
    assert max(note.finger for note in env.score.notes) == 3


def test_of_a_chord_of_five_notes_one_is_let_go():
    chord = score_of(*((0.0, 1.0, C4 + 2 * i, i) for i in range(5)))
    env = PianoEnv(chord, hand=LEAP, fingering="robot", hands_in_scene="right")
    assert (env.roll.finger[5] >= 0).sum() == 4
    assert release_early(env.roll, env.scene.hand).early_releases == env.roll.early_releases


def test_it_follows_a_plan_and_its_take_knows_the_hand(tmp_path):
    env = leap_env(fingering="robot")
    (take,) = rollout(make_player("planned", env), env)
    assert take.metrics["f1"] > 0.85
    take.write(tmp_path / "take.npz")
    assert Take.read(tmp_path / "take.npz").scene.hand is env.scene.hand


def test_a_hand_that_slides_along_the_keyboard_alone_is_planned_too(tmp_path):
    folder = Path(shutil.copytree(LEAP, tmp_path / "leap"))
    text = (folder / "hand.yml").read_text()
    text = text.replace(", across: across", "").replace("    across: 0.03\n", "")
    (folder / "hand.yml").write_text(text)
    lines = (folder / "right.xml").read_text().splitlines()
    kept = (line for line in lines if '"rh_across"' not in line)
    (folder / "right.xml").write_text("\n".join(kept).replace('pos="0.126 0.15', 'pos="0.096 0.15'))
    env = leap_env(hand=folder, fingering="robot")
    (take,) = rollout(make_player("planned", env), env)
    assert env.action_space.shape == (17 + 1,)
    assert np.isfinite(take.qpos).all()
    assert take.metrics["f1"] > 0.7
