"""A player that is easy to know and to learn, and environments that cost nothing."""

import gymnasium as gym
import numpy as np


class Linear:
    """Plays a fixed linear function of the observation, so that it is easy to know and to learn."""

    def __init__(self, env, scale=0.3, seed=0):
        shape = (env.action_space.shape[0], env.observation_space.shape[0])
        self._matrix = np.random.default_rng(seed).normal(size=shape) * scale
        self._space = env.action_space

    def act(self, observations):
        """Return the actions for (n, m) observations."""
        actions = np.tanh(observations @ self._matrix.T) * self._space.high
        return actions.astype(np.float32)

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return self.act(observation[None])[0], state


def pendulum(steps=20):
    """Return an environment that costs nothing; its actions are from -2 to 2."""
    return gym.make("Pendulum-v1", max_episode_steps=steps)


class Ending(gym.Wrapper):
    """Ends each episode after some steps, by itself and not by a time limit."""

    def __init__(self, env, after):
        super().__init__(env)
        self._after = after

    def reset(self, **kwargs):
        self._left = self._after
        return self.env.reset(**kwargs)

    def step(self, action):
        observation, reward, _, truncated, info = self.env.step(action)
        self._left -= 1
        return observation, reward, self._left == 0, truncated, info
