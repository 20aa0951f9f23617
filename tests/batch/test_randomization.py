"""Episodes differ in their physics, latency and noise, alike in a batch and in one environment."""

import functools
import pickle

import numpy as np
import pytest
import torch
from yaml_rows import Tables

from sb3_piano.batch import BatchedPiano
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score
from sb3_piano.wrappers import DomainRandomization, HandActions, HandReward

NOTES = [Note(onset=0.15 * i, offset=0.15 * i + 0.15, pitch=60 + i, finger=i) for i in range(4)]
SCORE = Score(notes=NOTES, title="four notes")
FAST = {"physics": "fast"}
FIXED = Tables(__file__)["fixed"]


def wandering(steps, size, seed=0):
    """Return actions that wander about the resting place."""
    random, action, actions = np.random.default_rng(seed), np.zeros(size), []
    for _ in range(steps):
        action = np.clip(0.8 * action + 0.5 * random.normal(size=size), -1, 1)
        actions.append(action.astype(np.float32))
    return actions


def played(env, seed=None):
    """Return the observations and rewards of an episode."""
    rows = [env.reset(seed=seed)[0]]
    for action in wandering(12, env.action_space.shape[0]):
        observation, reward, *_ = env.step(action)
        rows.append(np.append(observation, reward))
    return rows


@pytest.mark.parametrize(
    ("changed", "wrappers"),
    [*((name, ()) for name in FIXED), ("every", (HandActions, HandReward))],
)
def test_a_batch_plays_under_the_conditions_of_one_environment(changed, wrappers):
    options = {**FAST, "observation": "hands" if wrappers else "fingers"}
    conditions = FIXED if changed == "every" else {changed: FIXED[changed]}
    made = (functools.partial(DomainRandomization, **conditions), *wrappers)
    env = PianoEnv(SCORE, **options)
    plain = functools.reduce(
        lambda env, wrapper: wrapper(env), wrappers, PianoEnv(SCORE, **options)
    )
    env = functools.reduce(lambda env, wrapper: wrapper(env), made, env)
    batch = BatchedPiano(2, SCORE, wrappers=made, **options)
    rows, usual = played(env), played(plain)
    np.testing.assert_array_equal(batch.reset()[1].numpy(), rows[0])
    for action, row in zip(wandering(12, env.action_space.shape[0]), rows[1:], strict=True):
        seen = batch.step(torch.from_numpy(np.stack([action] * 2)))
        np.testing.assert_array_equal(seen.observation[1].numpy(), row[:-1].astype(np.float32))
        assert seen.reward[1].item() == pytest.approx(row[-1], abs=1e-12)
    assert any(not np.array_equal(one, other) for one, other in zip(rows, usual, strict=True))


def test_nothing_is_changed_by_default():
    alone, inside = (
        played(env)
        for env in (PianoEnv(SCORE, **FAST), DomainRandomization(PianoEnv(SCORE, **FAST)))
    )
    for one, other in zip(alone, inside, strict=True):
        np.testing.assert_array_equal(one, other)


def test_seeds_decide_and_episodes_differ():
    ranges = {"friction": (0.2, 2.0), "keyboard_offset": 0.01, "observation_noise": 0.01}
    env = DomainRandomization(PianoEnv(SCORE, observation="fingers", **FAST), **ranges)
    one, same, other = played(env, 3), played(env, 3), played(env, 4)
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0], other[0])
    batches = [
        BatchedPiano(
            3,
            SCORE,
            seed=seed,
            wrappers=[functools.partial(DomainRandomization, **ranges)],
            observation="fingers",
            **FAST,
        )
        for seed in (3, 3, 4)
    ]
    rows = [batch.reset().numpy() for batch in batches]
    np.testing.assert_array_equal(rows[0], rows[1])
    assert not np.array_equal(rows[0], rows[2])
    assert not np.array_equal(rows[0][0], rows[0][1])
    friction = batches[0].worlds.fields["geom_friction"][:, 0, 0]
    assert len(set(friction.tolist())) == 3


def test_a_restored_state_has_its_delayed_actions():
    env = DomainRandomization(PianoEnv(SCORE, **FAST), latency=(2, 2))
    env.reset(seed=0)
    actions, piano = wandering(9, env.action_space.shape[0]), env.unwrapped
    for action in actions[:4]:
        env.step(action)
    state, moment, other = piano.get_state(), piano.snapshot(), PianoEnv(SCORE, **FAST)
    state = pickle.loads(pickle.dumps(state))
    expected = [env.step(action)[0] for action in actions[4:]]
    for one, restore in (
        (piano, lambda: piano.set_state(state)),
        (piano, lambda: piano.go_back(moment)),
        (other, lambda: other.set_state(state)),
    ):
        restore()
        np.testing.assert_array_equal([one.step(action)[0] for action in actions[4:]], expected)


def test_conditions_do_not_add_up_over_episodes():
    env = DomainRandomization(PianoEnv(SCORE, **FAST), mass=(2.0, 2.0), keyboard_offset=0.01)
    before = env.unwrapped.model.body_mass.sum()
    for _ in range(3):
        env.reset()
    model = env.unwrapped.model
    assert before < model.body_mass.sum() < 2 * before
    assert np.abs(model.body_pos[1]).max() <= 0.01


def test_ranges_are_checked():
    env = PianoEnv(SCORE, **FAST)
    with pytest.raises(ConfigError, match=r"mass is \(2, 1\): expected the lowest number first"):
        DomainRandomization(env, mass=(2, 1))
    with pytest.raises(ConfigError, match="latency"):
        DomainRandomization(env, latency=(0, 1.5))
    with pytest.raises(ConfigError, match="DomainRandomization is around HandActions"):
        BatchedPiano(1, SCORE, wrappers=[HandActions, DomainRandomization], observation="hands")
    with pytest.raises(ConfigError, match="friction"):
        DomainRandomization(env, friction=0.5)
