"""Reward terms from outside: how they are named, what they see, and what is refused."""

import copy
import functools
import math
import pickle

import gymnasium as gym
import numpy as np
import own_terms
import pytest

from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnv, PianoEnvConfig, Term
from sb3_piano.envs.terms import SELF_ACTUATED_TERMS, TERMS
from sb3_piano.exceptions import ConfigError, EnvStateError
from sb3_piano.metrics import DEFINITIONS
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import FingeringDecay, RewardTiering, RewardWeights

SCORE = Score(notes=[Note(onset=0.1, offset=0.5, pitch=60, finger=0)], title="one note")
SMOOTH = {"smooth": "own_terms.smooth"}


def piano(terms=SMOOTH, **options):
    env = PianoEnv(SCORE, physics="fast", reward_terms=terms, **options)
    env.reset(seed=0)
    return env


def random_actions(env, steps):
    random = np.random.default_rng(3)
    return random.uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


def played(env, actions):
    return [env.step(action) for action in actions]


def of(steps, name="smooth"):
    return [info["reward_terms"][name] for *_, info in steps]


@pytest.mark.parametrize("given", ["own_terms.smooth", own_terms.smooth, Term(own_terms.smooth)])
def test_a_term_is_weighed_summed_up_and_told_like_those_built_in(given):
    env = gym.make(
        "RoboPianist-v0",
        score=SCORE,
        reward_terms={"smooth": given},
        reward_weights={"smooth": 0.1},
    )
    env.reset(seed=0)
    actions = random_actions(env, 8)
    steps = played(env, actions)
    before = [env.unwrapped.rest_action, *actions[:-1]]
    changes = np.subtract(actions, before)[:, :-1]  # the last one is the pedal's
    expected = [-float(np.square(change).sum()) for change in changes]
    assert of(steps) == pytest.approx(expected, rel=1e-5)
    weights = {**DEFAULT_REWARD_WEIGHTS, "smooth": 0.1}
    for _, reward, _, _, info in steps:
        assert list(info["reward_terms"]) == list(weights)
        assert reward == sum(weights[n] * value for n, value in info["reward_terms"].items())
    assert steps[-1][-1]["return_smooth"] == pytest.approx(0.1 * sum(expected), rel=1e-5)


def test_without_a_weight_a_function_has_1_and_a_term_its_own():
    weights = PianoEnvConfig(reward_terms={**SMOOTH, "still": own_terms.still}).reward_weights
    assert weights == {**DEFAULT_REWARD_WEIGHTS, "smooth": 1.0, "still": 0.25}
    assert PianoEnvConfig(reward_terms=SMOOTH, hands_in_scene="none").reward_weights["smooth"] == 1


def test_the_highest_return_has_the_best_of_a_term():
    plain, still, smooth = (
        piano(terms).goal.highest_return for terms in ({}, {"still": own_terms.still}, SMOOTH)
    )
    assert still - plain == pytest.approx(0.25 * len(piano().roll))
    assert smooth == plain


def test_a_function_of_the_controls_goes_on_from_saved_states_as_before():
    env = piano()
    actions = random_actions(env, 8)
    played(env, actions[:3])
    state, moment, twin = env.get_state(), env.snapshot(), pickle.loads(pickle.dumps(env))
    expected = of(played(env, actions[3:]))
    env.reset(seed=1)
    env.set_state(state)
    assert of(played(env, actions[3:])) == expected
    assert of(played(twin, actions[3:])) == expected
    other = piano()
    other.set_state(copy.deepcopy(state))
    assert of(played(other, actions[3:])) == expected
    env.reset(seed=0)
    env.go_back(moment)
    assert of(played(env, actions[3:])) == expected


def test_a_state_of_other_terms_is_refused():
    state = piano().get_state()
    for terms, message in (
        ({"still": own_terms.still}, "reward terms .*dynamics, smooth, but here .*dynamics, still"),
        ({}, "returns is none"),
    ):
        with pytest.raises(EnvStateError, match=message):
            piano(terms).set_state(state)


def test_the_goal_the_pedal_and_what_was_struck_are_seen():
    seen = []

    def look(step):
        now = step.goal.steps[step.number]
        assert step.asked is now
        assert step.record.steps == step.number
        seen.append((step.asked.keys, step.pedal_down, step.record.struck, step.wrong))
        return 0

    env = piano({"look": look})
    action = env.rest_action
    action[-1] = 1.0
    env.step(action)
    env.data.qfrc_applied[env.scene.key_slice][39] = 1.0
    env.step(env.rest_action)
    assert [keys for keys, *_ in seen] == [now.keys for now in env.goal.steps[:2]]
    assert [down for _, down, *_ in seen] == [True, False]
    assert [sum(struck) for *_, struck, _ in seen] == [0, 1]
    assert [wrong for *_, wrong in seen] == [False, 39 not in seen[1][0]]


def test_a_state_alone_is_told_by_no_term_of_ones_own():
    built_in = set(DEFAULT_REWARD_WEIGHTS) - {"strike", "dynamics"}
    assert set(piano().reward_terms(0)) == built_in


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ({"smooth": "own_terms.smoth"}, "'smooth': .*has no 'smoth'. Did you mean 'smooth'"),
        ({"smooth": "no_such_module.smooth"}, "'smooth': .*No module named"),
        ({"smooth": "smooth"}, "'smooth': 'smooth' is no import path: expected 'package.module"),
        ({"smooth": "own_terms.broken"}, "'smooth' is 3: expected a function of the step, a Term"),
        ({"smooth": None}, "'smooth' is None: expected a function"),
        ({"smooth": float}, "'smooth' is <class 'float'>: expected a function"),
        ({"energy": own_terms.smooth}, "'energy' is built in: expected another name, or reward_w"),
        ({"distance": own_terms.smooth}, "'distance' is built in"),
        ({"very smooth": own_terms.smooth}, "'very smooth' has no valid name: expected letters"),
        ("own_terms.smooth", "reward_terms is 'own_terms.smooth': expected a mapping"),
    ],
)
def test_what_is_no_term_is_refused_by_its_name(terms, message):
    with pytest.raises(ConfigError, match=message):
        PianoEnvConfig(reward_terms=terms)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"value": 3}, "value is 3: expected a function"),
        ({"value": abs, "best": 1.0}, "best is 1.0: expected a function"),
        ({"value": abs, "weight": math.nan}, "weight is nan: expected a finite number from -1e"),
        ({"value": abs, "label": 3}, "label is 3: expected text"),
    ],
)
def test_a_term_is_made_of_what_fits(values, message):
    with pytest.raises(ConfigError, match=message):
        Term(**values)


@pytest.mark.parametrize("value", [math.nan, math.inf, None, "1", np.zeros(2)])
def test_a_value_that_is_no_finite_number_is_refused_and_ends_the_episode(value):
    env = piano({"odd": lambda step: value if step.number == 1 else np.float32(0.5)})
    assert type(of([env.step(env.rest_action)], "odd")[0]) is float
    with pytest.raises(ConfigError, match="'odd' is .* in control step 1: expected a finite"):
        env.step(env.rest_action)
    with pytest.raises(EnvStateError, match="call reset"):
        env.step(env.rest_action)


@pytest.mark.parametrize(
    "wrapper",
    [
        functools.partial(RewardWeights, weights={"smooth": 2.0}),
        functools.partial(FingeringDecay, n_steps=4),
        RewardTiering,
    ],
)
def test_wrappers_of_the_reward_weigh_it_with_the_others(wrapper):
    env = wrapper(piano({**SMOOTH, "still": own_terms.still}, reward_weights={"smooth": 0.1}))
    for action in random_actions(env, 4):
        _, reward, _, _, info = env.step(action)
        weights = env.reward_weights
        assert weights["smooth"] == (2.0 if isinstance(env, RewardWeights) else 0.1)
        terms = info["reward_terms"]
        assert reward == pytest.approx(sum(weights[name] * terms[name] for name in terms))


def test_each_term_built_in_is_told_in_words():
    assert {f"return_{name}" for name in TERMS} <= DEFINITIONS.keys()
    assert all(term.value.__doc__ for term in (*TERMS.values(), *SELF_ACTUATED_TERMS.values()))
