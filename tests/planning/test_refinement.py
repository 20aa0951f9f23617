"""Rehearsals: a plan is played, and what goes wrong is tried otherwise."""

from __future__ import annotations

import numpy as np
import pytest

from sb3_piano.envs import PianoEnv
from sb3_piano.music import Note, Score
from sb3_piano.planning import PlannedPianist, PlanSettings, plan
from sb3_piano.simulation import compile_scene

pytestmark = pytest.mark.slow

# A leap there and back, which costs the plan some frames.
SCORE = Score(
    notes=[
        Note(onset=0.3 * i, offset=0.3 * (i + 1), pitch=pitch, finger=finger)
        for i, (pitch, finger) in enumerate([(60, 0), (72, 1), (74, 2), (60, 0)])
    ]
)
SETTINGS = PlanSettings(rounds=2, iterations=6, rehearsals=8)
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
