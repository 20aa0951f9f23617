"""The fingering term fades out with the steps that were played."""

from __future__ import annotations

import copy
import pickle

import pytest

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import FingeringDecay, RewardWeights

# Four control steps with the last, silent one.
SHORT = Score(notes=[Note(onset=0.0, offset=0.15, pitch=60, finger=0)], title="short")


def piano(**options):
    return PianoEnv(SHORT, physics="fast", **options)


def weights_of(env, steps):
    """Return the weight of the fingering term that each control step's reward reveals."""
    found = []
    for _ in range(steps):
        _, reward, _, truncated, info = env.step(env.unwrapped.rest_action)
        terms = dict(info["reward_terms"])
        fingering = terms.pop("fingering")
        others = sum(DEFAULT_REWARD_WEIGHTS[name] * value for name, value in terms.items())
        found.append((reward - others) / fingering if fingering else None)
        if truncated:
            env.reset()
    return found


def approx(values):
    return [None if value is None else pytest.approx(value) for value in values]


def test_the_weight_falls_linearly_over_episodes_and_stays():
    env = FingeringDecay(piano(), 5, start=2)
    env.reset(seed=0)
    # the fourth step of each episode has no finger label
    assert weights_of(env, 12) == approx([1, 1, 0.8, None, 0.4, 0.2, 0, None, 0, 0, 0, None])


@pytest.mark.parametrize(
    ("inner", "final", "expected"),
    [
        (1.0, 0.5, [0.75, 0.5, 0.5]),
        (1.0, 3, [2.0, 3.0, 3.0]),  # it may rise as well
        (4.0, 0.0, [2.0, 0.0, 0.0]),
        (0.0, 0.0, [0.0, 0.0, 0.0]),
    ],
)
def test_it_starts_from_the_weight_inside_and_ends_at_the_final_one(inner, final, expected):
    made = FingeringDecay(piano(reward_weights={"fingering": inner}), 2, final=final)
    wrapped = FingeringDecay(RewardWeights(piano(), {"fingering": inner}), 2, final=final)
    for env in (made, wrapped):
        env.reset(seed=0)
        assert weights_of(env, 3) == approx(expected)


def test_after_the_last_step_the_final_weight_is_exact():
    env = FingeringDecay(piano(), 3, final=0.1)
    env.reset(seed=0)
    weights_of(env, 3)
    assert env.reward_weights["fingering"] == 0.1


def test_it_goes_on_from_the_steps_that_were_played_before():
    env = FingeringDecay(piano(), 10)
    env.unwrapped.total_steps = 6
    env.reset(seed=0)
    assert weights_of(env, 3) == approx([0.3, 0.2, 0.1])


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_each_environment_counts_its_own_steps(clone):
    env = FingeringDecay(piano(), 10)
    env.reset(seed=0)
    weights_of(env, 1)
    twin = clone(env)
    assert weights_of(env, 2) == approx([0.8, 0.7])
    assert weights_of(twin, 2) == approx([0.8, 0.7])
    assert (env.unwrapped.total_steps, twin.unwrapped.total_steps) == (3, 3)


def test_two_decays_multiply_and_do_not_disturb_each_other():
    env = FingeringDecay(FingeringDecay(piano(), 4), 2)
    env.reset(seed=0)
    assert weights_of(env, 3) == approx([0.75 * 0.5, 0, 0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"n_steps": 0}, "n_steps is 0: expected a whole number, 1 or more"),
        ({"n_steps": 2.5}, r"n_steps is 2.5: expected a whole number"),
        ({"n_steps": "1e5"}, "n_steps is '1e5': expected a whole number"),
        ({"n_steps": True}, "n_steps is True: expected a whole number"),
        ({"n_steps": 5, "start": -1}, "start is -1: expected a whole number, 0 or more"),
        ({"n_steps": 5, "start": 0.5}, "start is 0.5: expected a whole number"),
        ({"n_steps": 5, "final": float("inf")}, "final is inf: expected a finite number"),
        ({"n_steps": 5, "final": "0"}, "final is '0': expected a finite number"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(ConfigError, match=message):
        FingeringDecay(piano(), **arguments)
