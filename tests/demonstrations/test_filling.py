"""Data sets in replay buffers: what stands there is what the algorithm would have stored."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import RescaleAction
from linear_players import Ending, pendulum
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.vec_env import DummyVecEnv
from yaml_rows import Tables

from sb3_piano.buffers import CompactReplayBuffer
from sb3_piano.callbacks import DemonstrationsCallback
from sb3_piano.demonstrations import fill_replay_buffer, open_dataset, record
from sb3_piano.exceptions import ConfigError

NAME = "test/pendulum-v0"
BUFFERS = [ReplayBuffer, CompactReplayBuffer]


class Seeded(gym.Wrapper):
    """Begins its episodes from given seeds, one after the other."""

    def __init__(self, env, seeds):
        super().__init__(env)
        self._seeds = iter(seeds)

    def reset(self, *, seed=None, options=None):
        return self.env.reset(seed=next(self._seeds, 0), options=options)


class Replaying(TD3):
    """Plays given actions, and does all else as it is."""

    def _sample_action(self, learning_starts, action_noise=None, n_envs=1):
        action = self.to_play.pop(0)[None]
        return action, self.policy.scale_action(action)


def model_on(env, algorithm=TD3, **options):
    shared = {"buffer_size": 200, "policy_kwargs": {"net_arch": [4]}, "device": "cpu", "seed": 0}
    return algorithm("MlpPolicy", env, **{**shared, **options})


def arrays_of(buffer):
    """Return what the buffer's filled rows hold, read as sampling reads it."""
    rows = np.arange(buffer.size())
    return {
        "observations": [buffer.observations[rows, np.full(len(rows), env)] for env in range(1)],
        "next_observations": [buffer.next_observations[rows, rows * 0]],
        "actions": buffer.actions[rows],
        "rewards": buffer.rewards[rows],
        "dones": buffer.dones[rows],
        "timeouts": buffer.timeouts[rows],
    }


@pytest.mark.parametrize("kind", BUFFERS)
@pytest.mark.parametrize("wrap", [lambda env: env, lambda env: Ending(env, 15)])
def test_the_buffer_is_as_if_the_model_had_played(pendulum_data, kind, wrap):
    dataset = pendulum_data(wrap=wrap)
    steps = dataset.total_steps
    seeds = [n["seed"] for n in dataset.storage.get_episode_metadata(range(3))]
    player = model_on(Seeded(wrap(pendulum()), seeds), Replaying, learning_starts=1000)
    player.to_play = [action for episode in dataset for action in episode.actions]
    player.learn(steps)
    model = model_on(wrap(pendulum()), replay_buffer_class=kind)
    assert fill_replay_buffer(model, dataset) == steps
    assert model.replay_buffer.pos == steps
    np.testing.assert_equal(arrays_of(model.replay_buffer), arrays_of(player.replay_buffer))
    assert (np.abs(model.replay_buffer.actions[:steps]) <= 1).all()
    batch = model.replay_buffer.sample(500)
    # Only an end by itself is one, not a time limit.
    assert bool(batch.dones.any()) == (steps == 45)


@pytest.mark.parametrize("kind", BUFFERS)
def test_each_of_several_environments_gets_an_unbroken_stretch(pendulum_data, kind):
    dataset = pendulum_data(episodes=3)  # 60 transitions, in episodes of 20
    model = model_on(DummyVecEnv([pendulum] * 7), replay_buffer_class=kind, buffer_size=700)
    assert fill_replay_buffer(model, dataset) == 56
    buffer, every = model.replay_buffer, np.concatenate([e.observations[:-1] for e in dataset])
    after = np.concatenate([e.observations[1:] for e in dataset])
    rows = np.arange(8)
    for env in range(7):
        stretch = slice(env * 8, env * 8 + 8)
        np.testing.assert_array_equal(buffer.observations[rows, rows * 0 + env], every[stretch])
        np.testing.assert_array_equal(
            buffer.next_observations[rows, rows * 0 + env], after[stretch]
        )
        ends = {step - env * 8 for step in (19, 39) if stretch.start <= step < stretch.stop} | {7}
        assert set(np.flatnonzero(buffer.dones[:8, env])) == ends
        assert set(np.flatnonzero(buffer.timeouts[:8, env])) == ends  # so that none counts as one


def test_a_buffer_without_time_limits_is_told_no_end_that_was_none(pendulum_data):
    dataset = pendulum_data(episodes=1)
    spaces = (dataset.observation_space, dataset.action_space)
    buffer = ReplayBuffer(30, *spaces, "cpu", n_envs=2, handle_timeout_termination=False)
    fill_replay_buffer(buffer, dataset)
    np.testing.assert_array_equal(buffer.dones[:10], [[0, 0]] * 9 + [[0, 1]])


def test_a_data_set_of_other_kinds_of_space_is_refused():
    right = SimpleNamespace(predict=lambda observation, state, *_, **options: (1, state))
    dataset = record(right, gym.make("CartPole-v1"), "test/cart-v0").dataset
    assert list(dataset[0].actions) == [1] * len(dataset[0])
    buffer = ReplayBuffer(500, dataset.observation_space, dataset.action_space, "cpu")
    with pytest.raises(ConfigError, match=r"Discrete\(2\): expected a Box"):
        fill_replay_buffer(buffer, dataset)


def test_a_training_begins_with_the_data_set_and_learns_from_it(pendulum_data):
    pendulum_data()
    model = model_on(pendulum(), SAC, learning_starts=0, train_freq=5)
    before = model.replay_buffer.size()
    model.learn(5, callback=DemonstrationsCallback(NAME))
    assert (before, model.replay_buffer.size()) == (0, 65)
    np.testing.assert_array_equal(
        model.replay_buffer.observations[:20, 0], open_dataset(NAME)[0].observations[:-1]
    )
    assert model._n_updates == 1
    model.learn(5, callback=DemonstrationsCallback(NAME), reset_num_timesteps=False)
    assert model.replay_buffer.size() == 70  # one that goes on does not get it again


UNFIT = {
    "no buffer": lambda: PPO("MlpPolicy", pendulum(), n_steps=8, batch_size=8, device="cpu"),
    "other observations": lambda: model_on(gym.make("MountainCarContinuous-v0")),
    "other action ranges": lambda: model_on(RescaleAction(pendulum(), *np.float32([-1, 1]))),
    "too small": lambda: model_on(pendulum(), buffer_size=59),
}


@Tables(__file__)("model, message")
def test_a_model_that_does_not_fit_the_data_set_is_refused(pendulum_data, model, message):
    pendulum_data()
    with pytest.raises(ConfigError, match=message):
        fill_replay_buffer(UNFIT[model](), NAME)
