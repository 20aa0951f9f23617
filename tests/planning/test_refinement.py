"""Rehearsals: a plan is played, and what goes wrong is tried otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Note, PianoRoll, Score
from sb3_piano.planning import PlannedPianist, PlanSettings, plan
from sb3_piano.planning.hand_plan import replan_hands
from sb3_piano.planning.refinement import _errors
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
ON_STAGE = {"reduced_action_space": False, "initial_buffer_time": 0.5, "fingering": "robot"}


@pytest.fixture(scope="module")
def scene():
    return compile_scene(reduced_action_space=False)


def f1_of(settings: PlanSettings) -> float:
    """Play the score and return its F1 as the environment tells it."""
    env = PianoEnv(SCORE, **ON_STAGE)
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


def test_a_new_plan_changes_only_what_is_free(scene):
    roll = PianoRoll.from_score(SCORE, 0.05, initial_buffer_time=0.5)
    made = plan(roll, scene, PLAIN)
    free = np.zeros(len(roll) + 1, dtype=bool)
    free[20:26] = True
    presses = [hand.task.presses for hand in made.hands]
    again = replan_hands(made.hands, presses, made.arm_line, free, PLAIN, 0.05)
    changed = False
    for hand, before in zip(again, made.hands, strict=True):
        np.testing.assert_array_equal(hand.weightless[~free], before.weightless[~free])
        changed |= bool((hand.weightless[free] != before.weightless[free]).any())
    assert changed


def test_what_is_heard_at_a_rehearsal_is_what_the_environment_hears(scene):
    env = PianoEnv(SCORE, **ON_STAGE)
    env.reset(seed=0)
    made = plan(env.roll, scene, PLAIN)
    errors = _errors(made.hands, made.roll, scene, PLAIN)
    assert 1 - errors.mean() == pytest.approx(f1_of(PLAIN), abs=1e-12)
