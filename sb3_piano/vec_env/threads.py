"""Vector environment of Stable-Baselines3 that steps environments in threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnvObs,
    VecEnvStepReturn,
)

from sb3_piano.threads import ThreadTeam


class ThreadVecEnv(DummyVecEnv):
    """``DummyVecEnv`` whose environments step, reset, render and close in threads.

    Results equal those of ``DummyVecEnv`` exactly. It is faster with environments that release
    Python's lock while they compute, such as MuJoCo's. Other than with ``SubprocVecEnv``,
    observations stay in the process and ``venv.envs`` are the environments themselves. Environments
    must not share state that a step changes, such as ``numpy.random``'s global generator.

    ``make_vec_env(env_id, n_envs=4, vec_env_cls=ThreadVecEnv)`` makes one; in a run's YAML use
    ``vec_env: threads``. For RL Zoo run a script in place of ``rl_zoo3.train``::

        from rl_zoo3.exp_manager import ExperimentManager
        from rl_zoo3.train import train

        from sb3_piano.vec_env import ThreadVecEnv

        ExperimentManager.default_vec_env_cls = ThreadVecEnv
        train()

    An error in one environment is raised when all threads have stopped; the other environments may
    have played that step. After it, as after Ctrl-C, call ``reset``.

    Args:
        env_fns: Functions that make the environments.
        n_threads: Threads to use, the calling one included; by default one for each environment or
            each usable core, whichever are fewer.

    Raises:
        ConfigError: If ``n_threads`` is not a whole number from 1 on.
    """

    def __init__(
        self, env_fns: list[Callable[[], gym.Env[Any, Any]]], n_threads: int | None = None
    ) -> None:
        super().__init__(env_fns)
        self._team = ThreadTeam(self.num_envs, n_threads)

    def step_wait(self) -> VecEnvStepReturn:
        """Play one step in every environment; reset environments whose episode ended."""
        self._team.run(self._step_env)
        return (
            self._obs_from_buf(),
            np.copy(self.buf_rews),
            np.copy(self.buf_dones),
            deepcopy(self.buf_infos),
        )

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment, with the seeds and options set for it."""
        self._team.run(self._reset_env)
        self._reset_seeds()
        self._reset_options()
        return self._obs_from_buf()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Return a picture of every environment."""
        if self.render_mode != "rgb_array":
            return super().get_images()  # warns
        images: list[np.ndarray | None] = [None] * self.num_envs

        def draw(index: int) -> None:
            images[index] = self.envs[index].render()  # type: ignore[assignment]

        self._team.run(draw)
        return images

    def close(self) -> None:
        """Close every environment, then end the threads."""
        try:
            self._team.run(lambda index: self.envs[index].close())
        finally:
            self._team.close()

    # What DummyVecEnv does in its loops. Each call writes into rows of its own.

    def _step_env(self, index: int) -> None:
        env = self.envs[index]
        observation, reward, terminated, truncated, info = env.step(self.actions[index])
        self.buf_rews[index] = reward
        self.buf_dones[index] = terminated or truncated
        info["TimeLimit.truncated"] = truncated and not terminated
        if self.buf_dones[index]:
            info["terminal_observation"] = observation
            observation, self.reset_infos[index] = env.reset()
        self.buf_infos[index] = info
        self._save_obs(index, observation)

    def _reset_env(self, index: int) -> None:
        options = {"options": self._options[index]} if self._options[index] else {}
        observation, self.reset_infos[index] = self.envs[index].reset(
            seed=self._seeds[index], **options
        )
        self._save_obs(index, observation)
