"""Rehearsals: a plan is played, and what goes wrong is tried otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.planning import PlannedPianist, PlanSettings, plan
from sb3_piano.planning.fingers import fit_fingers
from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.piece_planner import PiecePlanner
from sb3_piano.planning.rehearsal import rehearse
from sb3_piano.simulation import compile_scene

pytestmark = pytest.mark.slow

# A leap there and back, which costs the plan some frames.
SCORE = Score(
    notes=[
        Note(onset=0.3 * i, offset=0.3 * (i + 1), pitch=pitch, finger=finger)
        for i, (pitch, finger) in enumerate([(60, 0), (72, 1), (74, 2), (60, 0)])
    ]
)
SETTINGS = PlanSettings(rounds=2, iterations=6, rehearsals=4)
PLAIN = PlanSettings(rounds=2, iterations=6)


@pytest.fixture(scope="module")
def scene():
    return compile_scene(reduced_action_space=False)


def f1_of(settings: PlanSettings) -> float:
    """Play the score and return its F1 as the environment tells it."""
    env = PianoEnv(SCORE, reduced_action_space=False, initial_buffer_time=0.5)
    observation, _ = env.reset(seed=0)
    pianist, ended, state = PlannedPianist(env, settings), False, None
    while not ended:
        action, state = pianist.predict(observation, state)
        observation, _, _, ended, info = env.step(action)
    return float(info["f1"])


def test_a_rehearsed_plan_sounds_better_on_stage():
    plain = f1_of(PLAIN)
    assert plain < 1
    assert f1_of(SETTINGS) > plain


def test_the_same_rehearsals_lead_to_the_same_plan(scene):
    first, second = (plan(SCORE, scene, SETTINGS) for _ in range(2))
    np.testing.assert_array_equal(first.commands, second.commands)
    assert (first.commands != plan(SCORE, scene, PLAIN).commands).any(), "it found something"


def test_without_rehearsals_the_plan_remains(scene):
    roll = PianoRoll.from_score(SCORE, 0.05, initial_buffer_time=0.5)
    planner = PiecePlanner(roll, scene, SETTINGS)
    planner.plan()
    before = [hand.commands.copy() for hand in planner.hands]
    timed = [list(hand.timed) for hand in planner.hands]
    rehearse(planner, roll, scene, PLAIN)
    for hand, commands, presses in zip(planner.hands, before, timed, strict=True):
        np.testing.assert_array_equal(hand.commands, commands)
        assert hand.timed == presses


def test_a_new_plan_changes_only_what_is_free(scene):
    roll = PianoRoll.from_score(SCORE, 0.05, initial_buffer_time=0.5)
    planner = PiecePlanner(roll, scene, SETTINGS)
    planner.plan()
    before = [hand.planned.copy() for hand in planner.hands]
    free = np.zeros(len(roll) + 1, dtype=bool)
    free[20:26] = True
    planner.replan([list(hand.timed) for hand in planner.hands], free)
    for hand, planned in zip(planner.hands, before, strict=True):
        np.testing.assert_array_equal(hand.planned[~free], planned[~free])
    assert any(
        (hand.planned[free] != planned[free]).any()
        for hand, planned in zip(planner.hands, before, strict=True)
    )


def test_what_is_heard_at_a_rehearsal_is_what_the_environment_hears(scene):
    from sb3_piano.planning.rehearsal import _Simulation

    env = PianoEnv(SCORE, reduced_action_space=False, initial_buffer_time=0.5)
    env.reset(seed=0)
    settings = PLAIN
    roll = fit_fingers(env.roll, KeyPlaces.of(scene), settings).roll
    planner = PiecePlanner(roll, scene, settings)
    planner.plan()
    errors = _Simulation(planner, roll, scene, settings).errors()
    assert 1 - errors.mean() == pytest.approx(f1_of(settings), abs=1e-12)


def test_a_number_of_rehearsals_below_0_is_refused():
    with pytest.raises(ConfigError, match="rehearsals is -1: expected 0 or more"):
        PlanSettings(rehearsals=-1)
