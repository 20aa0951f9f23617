"""RoboVirtuoso's tiers: the worked examples of its report, and when comfort counts.

The report counts keys that are played, the environment measures how far down each due key is: one
that is pushed to its end is fully down in both, one that is up has a closeness of
0.1 ** (0.95 / 0.5) ** 2 = 0.00025 in place of 0. Hence the tolerance of 0.0003.
"""

import numpy as np
import pytest
from short_scores import score_of
from yaml_rows import Tables

from sb3_piano.envs import PianoEnv
from sb3_piano.music.constants import NUM_KEYS
from sb3_piano.wrappers import KeyRewardTiering, RewardTiering

tables = Tables(__file__)
TOLERANCE = 0.0003

# Two keys are due for six control steps; in the seventh, none is.
C4, E4, WRONG = 60 - 21, 64 - 21, 70
CHORD = score_of((0.0, 0.3, 60, 0), (0.0, 0.3, 64, 2), title="chord")

# Keys that are played; the key reward of the report, old and tiered.
EXAMPLES = {
    "all 88 keys": (range(NUM_KEYS), 0.5, 0.5),
    "none": ((), 0.5, 0.0),
    "both right": ((C4, E4), 1.0, 1.0),
    "one right and one wrong": ((C4, WRONG), 0.25, 0.25),
}


@pytest.fixture
def piano():
    env = PianoEnv(CHORD, physics="fast")
    env.reset(seed=0)
    return env


def push(env, keys):
    """Hold keys down with outside torques."""
    for key in keys:
        joint = np.flatnonzero(env.model.jnt_qposadr == env.scene.key_qpos[key])
        env.data.qfrc_applied[env.model.jnt_dofadr[joint]] = 10.0


def play(env, keys, steps=2):
    """Return reward and terms of the last of some control steps in which keys are held down."""
    piano = env.unwrapped
    push(piano, keys)
    for _ in range(steps):
        _, reward, _, _, info = env.step(piano.rest_action)
    return reward, info["reward_terms"]


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_reports_examples_change_this_term_and_no_other(example, piano):
    keys, old, tiered = EXAMPLES[example]
    terms = play(piano, keys)[1]
    assert terms["key_press"] == pytest.approx(old, abs=TOLERANCE)
    env = KeyRewardTiering(piano)
    env.reset(seed=0)
    expected = {**terms, "key_press": pytest.approx(tiered, abs=TOLERANCE)}
    assert play(env, keys)[1] == expected


@pytest.mark.parametrize(("keys", "expected"), [((), 0.5), ((WRONG,), 0.0)])
def test_where_nothing_is_due_the_term_stays(piano, keys, expected):
    assert play(KeyRewardTiering(piano), keys, steps=7)[1]["key_press"] == expected


@tables("notes, options, held, expected", ids=["beginning", "end"])
def test_each_step_is_compared_with_its_own_goal(notes, options, held, expected):
    env = KeyRewardTiering(PianoEnv(score_of(*notes), physics="fast", **options))
    env.reset(seed=0)
    found = [play(env, keys, steps=1)[1]["key_press"] for keys in held]
    assert found == pytest.approx(expected, abs=TOLERANCE)


# Energy and forearms only once the keys are pressed well.


@tables("keys, steps, thresholds")
def test_comfort_counts_above_the_threshold(piano, keys, steps, thresholds):
    keys = range(NUM_KEYS) if keys == "all" else keys
    _, terms = play(piano, keys, steps)
    assert (terms["forearm"], terms["energy"] < 0.0) == (1.0, True)
    for threshold, counts in thresholds.items():
        env = RewardTiering(piano) if threshold == 0.5 else RewardTiering(piano, threshold)
        env.reset(seed=0)
        reward, tiered = play(env, keys, steps)
        expected = terms if counts else {**terms, "energy": 0.0, "forearm": 0.0}
        assert tiered == expected
        weights = piano.config.reward_weights
        assert reward == pytest.approx(sum(weights[name] * expected[name] for name in terms))
