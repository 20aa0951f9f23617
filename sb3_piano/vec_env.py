"""Vectors of environments for Stable-Baselines3: stepped in threads, or with hands as agents."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import (
    VecEnvIndices,
    VecEnvObs,
    VecEnvStepReturn,
)

from sb3_piano.exceptions import ConfigError
from sb3_piano.threads import ThreadTeam
from sb3_piano.wrappers.hand_reward import HAND_REWARDS


class ThreadVecEnv(DummyVecEnv):
    """A ``DummyVecEnv`` whose environments step, reset, draw and close in threads.

    It gives exactly what ``DummyVecEnv`` gives. It is faster with environments that release
    Python's lock while they compute, as all do that run on MuJoCo; and other than with
    ``SubprocVecEnv``, observations stay in the process and ``venv.envs`` are the environments
    themselves. Environments must share nothing that a step changes, such as ``numpy.random``'s
    global generator.

    ``make_vec_env(env_id, n_envs=4, vec_env_cls=ThreadVecEnv)`` makes one; in a run's YAML it is
    ``vec_env: threads``. RL Zoo takes it from a script that stands in for ``rl_zoo3.train``::

        from rl_zoo3.exp_manager import ExperimentManager
        from rl_zoo3.train import train

        from sb3_piano.vec_env import ThreadVecEnv

        ExperimentManager.default_vec_env_cls = ThreadVecEnv
        train()

    An error in one environment is raised when all threads have come to rest; the other environments
    may have played that step. After it, as after Ctrl-C, call ``reset``.

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

    @property
    def n_threads(self) -> int:
        """Number of threads that step the environments, the calling one included."""
        return self._team.n_threads

    def step_wait(self) -> VecEnvStepReturn:
        """Play one step in every environment; one whose episode ended is reset."""
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


class HandsAsAgents(VecEnvWrapper):
    """A vector in which each hand is an environment of its own, so that one policy learns for both.

    Environment ``2 i`` is the right hand of environment ``i``, ``2 i + 1`` the left one. Each
    observes its half of the observation "hands", acts by its half of
    :class:`~sb3_piano.wrappers.HandActions`, and gets its reward of
    :class:`~sb3_piano.wrappers.HandReward`; both end together. What is learnt is the network of
    one hand (``policy_kwargs: {n_hands: 1}`` of the policies of :mod:`sb3_piano.policies`).

    In a run's YAML: ``vec_env_wrapper: sb3_piano.vec_env.HandsAsAgents``.

    Args:
        venv: Environments whose observations and actions are two halves of equal meaning.

    Raises:
        ConfigError: If they cannot be halved.
    """

    def __init__(self, venv: VecEnv) -> None:
        spaces = [_half(venv.observation_space), _half(venv.action_space)]
        super().__init__(venv, *spaces)
        self.num_envs = 2 * venv.num_envs

    def reset(self) -> VecEnvObs:
        """Begin an episode in every environment."""
        observations = self._halves(self.venv.reset())
        self.reset_infos = [info for info in self.venv.reset_infos for _ in (0, 1)]
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Play what both hands do."""
        self.venv.step_async(actions.reshape(self.venv.num_envs, -1))

    def step_wait(self) -> VecEnvStepReturn:
        """Return what each hand observes, and its reward."""
        observations, _, dones, infos = self.venv.step_wait()
        rewards = np.array([info[HAND_REWARDS] for info in infos], dtype=np.float32)
        return self._halves(observations), rewards.reshape(-1), dones.repeat(2), _of_hands(infos)

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the environments that hands are in."""
        inside = self._inside(indices)
        return self.venv.env_method(method_name, *args, indices=inside, **kwargs)

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the environments that hands are in."""
        return self.venv.get_attr(attr_name, self._inside(indices))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the environments that hands are in."""
        self.venv.set_attr(attr_name, value, self._inside(indices))

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return whether the environments that hands are in have a wrapper."""
        return self.venv.env_is_wrapped(wrapper_class, self._inside(indices))

    def _halves(self, observations: VecEnvObs) -> np.ndarray:
        assert isinstance(observations, np.ndarray), "boxes alone have halves"
        return observations.reshape(self.num_envs, -1)

    def _inside(self, indices: VecEnvIndices) -> list[int]:
        return [hand // 2 for hand in self._get_indices(indices)]


def _half(space: gym.Space[Any]) -> gym.spaces.Box:
    """Return the space of one hand."""
    if isinstance(space, gym.spaces.Box) and len(space.shape) == 1 and space.shape[0] % 2 == 0:
        low, high = space.low.reshape(2, -1), space.high.reshape(2, -1)
        if np.array_equal(low[0], low[1]) and np.array_equal(high[0], high[1]):
            return gym.spaces.Box(low[0], high[0], dtype=space.dtype.type)
    raise ConfigError(
        f"HandsAsAgents cannot give each hand half of {space}: expected two halves with equal "
        'bounds, as of the observation "hands" and of sb3_piano.wrappers.HandActions.'
    )


def _of_hands(infos: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the info of each hand; that of an episode is the right one's alone."""
    result = []
    for info in infos:
        ends = info.get("terminal_observation")
        for side in (0, 1):
            own = dict(info) if side == 0 else {k: v for k, v in info.items() if k != "episode"}
            if ends is not None:
                own["terminal_observation"] = ends.reshape(2, -1)[side]
            result.append(own)
    return result
