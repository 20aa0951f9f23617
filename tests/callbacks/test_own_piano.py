"""A piano of a callback's own: the model plays as it would anywhere else, and nobody notices."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from scripted import vector_of, with_f1
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from sb3_piano.callbacks.own_env import RunContext
from sb3_piano.callbacks.performance_video import OwnPiano
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.music import Note, Score

SCORE = Score(notes=[Note(onset=0.0, offset=0.275, pitch=60)])  # 6 control steps


class Shaken(gym.ActionWrapper):
    """Add random numbers of the environment and of numpy's global generator to the actions."""

    def action(self, action):
        shape = action.shape
        noise = self.unwrapped.np_random.normal(size=shape) + np.random.normal(size=shape)  # noqa: NPY002
        return np.clip(action + 0.3 * noise, -1, 1).astype(np.float32)


def shaken_piano():
    return Shaken(PianoEnv(score=SCORE, physics="fast", observation="window"))


@pytest.fixture
def model():
    venv = VecNormalize(vector_of(shaken_piano), clip_obs=0.5)
    kwargs = {"n_steps": 10, "batch_size": 10, "n_epochs": 1, "device": "cpu", "seed": 1}
    return PPO("MlpPolicy", venv, **kwargs)


def positions_by_another_road(model, seed, steps):
    """Return how the joints move, in a plain loop with the training's statistics."""
    env = shaken_piano()
    observation, _ = env.reset(seed=seed)
    np.random.seed(seed)  # noqa: NPY002
    rows = [env.unwrapped.data.qpos.copy()]
    for _ in range(steps):
        normalized = model.get_vec_normalize_env().normalize_obs(observation)
        observation, *_ = env.step(model.predict(normalized, deterministic=True)[0])
        rows.append(env.unwrapped.data.qpos.copy())
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize(("max_seconds", "steps"), [(60.0, 6), (0.2, 4), (0.15, 3), (0.01, 1)])
def test_an_episode_is_what_the_model_plays_until_it_is_cut_off(model, max_seconds, steps):
    piano = OwnPiano(model, None, max_seconds)
    model.learn(10)  # after the environment was copied, so that its statistics are old
    for seed in (4, 5):
        played = piano.play(seed)
        assert len(played.performance) == steps
        expected = positions_by_another_road(model, seed, steps)
        np.testing.assert_allclose(played.qpos, expected, rtol=0, atol=1e-12)
    assert played.scene.model.nq == played.qpos.shape[1]


def test_without_a_seed_it_goes_on_from_the_last_episode(model):
    piano = OwnPiano(model, None, 60.0)
    np.random.seed(3)  # noqa: NPY002
    first, second = piano.play(None), piano.play(None)
    assert not np.array_equal(first.qpos[-1], second.qpos[-1])


def test_the_global_generator_does_not_notice(model):
    np.random.seed(3)  # noqa: NPY002
    OwnPiano(model, None, 60.0).play(7)
    assert np.random.random() == np.random.RandomState(3).random()  # noqa: NPY002


def test_what_is_no_piano_is_named_and_closed(model, tmp_path):
    made = []

    def make_env(innermost):
        made.append(with_f1(0.1))
        return vector_of(lambda: innermost(made[-1]))

    with pytest.raises(ConfigError, match="to record in 'ScriptedEnv': expected a piano"):
        OwnPiano(model, RunContext(folder=tmp_path, make_env=make_env), 60.0)
    assert made[0].closed
