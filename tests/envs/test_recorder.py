"""Records of episodes, whoever ends them."""

from __future__ import annotations

import numpy as np
import pytest
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.vec_env import DummyVecEnv

from sb3_piano.envs import EpisodeRecorder, PianoEnv
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.music import Note, Score

STEPS = 8  # the note's 0.4 s, with the control step in which it ends
SCORE = Score(notes=[Note(onset=0.0, offset=0.35, pitch=60, finger=0)], title="one")


def recorded(max_steps, steps):
    """Play so many steps under a time limit around the recorder; return it and its actions."""
    recorder = EpisodeRecorder(PianoEnv(SCORE, physics="fast"))
    venv = DummyVecEnv([lambda: TimeLimit(recorder, max_steps)])
    venv.reset()
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, 1, 39)).astype(np.float32)
    for action in actions:
        venv.step(action)
    return recorder, actions[:, 0]


@pytest.mark.parametrize(("max_steps", "length"), [(3, 3), (STEPS, STEPS), (100, STEPS)])
def test_each_episode_is_recorded_once_whoever_ends_it(max_steps, length):
    recorder, actions = recorded(max_steps, 2 * length + 1)
    first, second = recorder.finished
    for one, own in ((first, actions[:length]), (second, actions[length : 2 * length])):
        assert one.metrics["length"] == len(one.performance) == length
        np.testing.assert_array_equal(one.motion.actions, own)
        assert one.motion.qpos.shape[0] == length + 1
    assert first.metrics["return"] != second.metrics["return"]


def test_an_episode_that_is_cut_off_has_the_numbers_of_its_steps():
    whole, cut = (recorded(steps, STEPS)[0].finished[0] for steps in (STEPS, 3))
    assert cut.metrics.keys() == whole.metrics.keys() > set(EPISODE_METRICS)
    assert cut.metrics["f1"] == cut.performance.metrics()["f1"]
    terms = [value for name, value in cut.metrics.items() if name.startswith("return_")]
    assert sum(terms) == pytest.approx(cut.metrics["return"])
