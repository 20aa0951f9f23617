"""Which fingers a score gets, and what may be chosen about a generated study, as options."""

import gymnasium as gym
import numpy as np
import pytest
from short_scores import score_of

from sb3_piano.batch import PianoVectorEnv
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.lab.music import generate_score
from sb3_piano.music import BUILT_IN, Score, load_score, write_midi
from sb3_piano.music.fingering import apply_fingering, finger_score
from sb3_piano.planning import PlanSettings, plan

PLAIN = score_of(
    *((0.5 * i, 0.5 * i + 0.4, 60 + i) for i in range(5)), title="plain", bars=(0.0, 2.0)
)


def fingers(env):
    return [note.finger for note in env.unwrapped.score.notes]


def test_ergonomic_labels_are_those_of_the_search_and_reach_roll_and_reward():
    env = PianoEnv(PLAIN, fingering="ergonomic", observation="fingers")
    env.reset(seed=0)
    assert env.score == finger_score(PLAIN)
    assert env.score.bars == PLAIN.bars
    assert set(env.roll.finger[env.roll.active]) == set(fingers(env))
    assert -1 not in fingers(env)
    *_, info = env.step(env.action_space.sample())
    assert 0 < info["reward_terms"]["fingering"] < 1


def test_a_score_named_at_reset_gets_fingers_too_and_so_does_a_changed_one():
    env = PianoEnv("TwinkleTwinkleLittleStar", fingering="ergonomic")
    env.reset(options={"score": PLAIN})
    assert env.score == finger_score(PLAIN)
    higher = PLAIN.transpose(1)
    env.reset(options={"transform": lambda score, random: higher})
    assert env.score == finger_score(higher)


# A thumb on a black key; then an octave that has to be left for another one far away.
AWKWARD = score_of((0.0, 0.4, 78, 0), (0.5, 1.5, 60, 0), (1.0, 1.5, 84, 4))


@pytest.mark.parametrize("observation", ["roll", "fingers"])
def test_the_robots_fingers_are_chosen_before_anything_is_observed_or_rewarded(observation):
    env = PianoEnv(AWKWARD, fingering="robot", observation=observation)
    env.reset(seed=0)
    assert env.default_score == AWKWARD
    assert env.score == apply_fingering(AWKWARD, "robot")
    assert env.score.notes[0].finger not in (0, -1)
    (released,) = env.roll.early_releases
    assert (released.key, released.release) == (60 - 21, 20)
    assert (env.roll.finger[20:30, 60 - 21] == -1).all()
    assert env.roll.active[20:30, 60 - 21].all(), "it is due all the same"
    labelled = env.roll.finger[env.roll.active]
    assert set(labelled.tolist()) - {-1} <= {note.finger for note in env.score.notes}


def test_the_robots_fingers_are_those_for_the_tempo_at_which_a_piece_is_played():
    env = PianoEnv(AWKWARD, fingering="robot")
    slower = AWKWARD.stretch(3.0)
    env.reset(options={"transform": lambda score, random: slower})
    assert env.score == apply_fingering(slower, "robot")


def test_planned_pianists_play_the_fingers_that_the_environment_shows():
    for fingering, thumb_plays in (("keep", True), ("robot", False)):
        env = PianoEnv(AWKWARD, fingering=fingering, physics="fast")
        env.reset(seed=0)
        made = plan(env.roll, env.scene, PlanSettings(rounds=1, iterations=1))
        assert (made.roll.finger[0, 78 - 21] == 0) == thumb_plays
        assert (made.roll.finger[env.roll.finger < 0] < 0).all()
        told = [problem.reason for problem in made.problems]
        assert "let go early by 0.50 s for C6" in told


def test_optimal_transport_takes_the_labels_away():
    env = PianoEnv("TwinkleTwinkleLittleStar", fingering="optimal-transport")
    env.reset(seed=0)
    assert fingers(env) == [-1] * 14
    plain = PianoEnv(env.score)
    plain.reset(seed=0)
    action = env.action_space.sample()
    assert env.step(action)[4] == plain.step(action)[4]


def test_equal_scores_keep_bars_of_their_own():
    other = Score(notes=PLAIN.notes, title=PLAIN.title, bars=(0.0, 1.0))
    env = PianoEnv("CMajorScaleOneHand", fingering="ergonomic")
    for score in (PLAIN, other):
        env.reset(options={"score": score})
        assert env.score.bars == score.bars


def test_labels_of_a_file_are_put_on_the_environments_own_score(tmp_path):
    labels = score_of(*((n.onset, n.offset, n.pitch, 1) for n in PLAIN.notes))
    write_midi(labels, tmp_path / "labels.mid")
    env = PianoEnv(PLAIN, fingering=str(tmp_path / "labels.mid"))
    env.reset(seed=0)
    assert fingers(env) == [1] * 5
    env.reset(options={"score": "CMajorScaleOneHand"})
    assert env.score == load_score("CMajorScaleOneHand")


@pytest.mark.parametrize(
    ("score", "fingering"),
    # Of the second one other fingers are found if they are looked for a second time.
    [(PLAIN, "ergonomic"), (generate_score(np.random.default_rng(27), 20.0), "robot")],
)
def test_a_state_is_put_back_with_its_fingers(score, fingering):
    env = PianoEnv(score, fingering=fingering, physics="fast")
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(env.action_space.shape))
    state, roll = env.get_state(), env.roll
    expected = env.step(np.zeros(env.action_space.shape))
    env.reset(options={"score": "CMajorScaleOneHand"})
    env.set_state(state)
    again = env.step(np.zeros(env.action_space.shape))
    np.testing.assert_array_equal(again[0], expected[0])
    assert again[1:] == expected[1:]
    assert env.roll.equals(roll)


@pytest.mark.parametrize("fingering", ["ergonomics", "labels.mid", 3])
def test_another_way_of_fingering_is_refused(fingering):
    with pytest.raises(ConfigError, match=f"ingering .*{fingering!r}.*"):
        PianoEnv(PLAIN, fingering=fingering)


def test_options_of_a_study_are_options_of_its_environment_also_in_a_vector():
    options = {"tempo": 160, "hands": "left", "repeats": 2}
    expected = BUILT_IN["scale-DMajor"].score(**options)
    assert {note.hand for note in expected.notes} == {"left"}
    name = "RoboPianist-scale-DMajor-v0"
    assert gym.make(name, **options).unwrapped.default_score == expected
    for envs in (
        gym.make_vec(name, num_envs=2, **options),
        PianoVectorEnv(2, "scale-DMajor", **options),
    ):
        assert envs.envs[1].default_score == expected


def test_a_piece_without_options_refuses_them_as_any_unknown_option():
    with pytest.raises(ConfigError, match="Unknown option 'tempo' of the piano environment"):
        PianoEnv("TwinkleTwinkleLittleStar", tempo=100)
