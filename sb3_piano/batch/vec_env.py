"""Vector environment of Stable-Baselines3 for a batch, with NumPy arrays."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from sb3_piano.batch.environment import BatchedPiano
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.metrics import EPISODE_METRICS
from sb3_piano.wrappers.hand_reward import HAND_REWARDS

_OF_A_WORLD = ("steps_played", "total_steps", "performance", "piece_index", "set_piece_weights")
"""Attributes that a single environment has of its own episodes."""


class BatchVecEnv(VecEnv):
    """Stable-Baselines3 vector environment of a :class:`BatchedPiano`.

    A world whose episode ends starts the next one at once. The ``info`` of the last step has the
    music metrics of a single environment, and ``episode``, as from a ``Monitor``. A ``Monitor``
    among the wrappers writes the rows of all worlds to its file. Attributes and methods belong to
    the one environment that is batched.

    Args:
        batch: The batched pianos.
    """

    def __init__(self, batch: BatchedPiano):
        self.batch = batch
        """The batched pianos, with access to their tensors."""
        super().__init__(batch.num_envs, batch.observation_space, batch.action_space)
        every = layers(batch.env)
        self._monitor = next((one for one in every if isinstance(one, Monitor)), None)
        self._start = time.time()
        self._actions = np.empty(0)

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed all later random draws."""
        self.batch.seed(seed)
        return [seed] * self.num_envs

    def reset(self) -> np.ndarray:
        """Start an episode in every world."""
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return _array(self.batch.reset())

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions, (N, n), for the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Run the step; reset worlds whose episode ended."""
        batch = self.batch
        observation, reward, terminated, truncated = batch.step(torch.as_tensor(self._actions))
        ended = terminated | truncated
        done = _array(ended)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if batch.hand_rewards is not None:
            for info, each in zip(infos, _array(batch.hand_rewards), strict=True):
                info[HAND_REWARDS] = each
        if done.any():
            self._end(infos, np.flatnonzero(done), observation, _array(truncated & ~terminated))
            observation = batch.reset(ended)
        return _array(observation), _array(reward).astype(np.float32), done, infos

    def _end(
        self, infos: list[dict[str, Any]], worlds: np.ndarray, last: torch.Tensor, cut: np.ndarray
    ) -> None:
        rows = _array(last[torch.from_numpy(worlds).to(last.device)])
        steps = _array(self.batch.steps)
        returns = _array(self.batch.sums.earned)
        found = self.batch.summaries(worlds.tolist())
        for world, row, metrics in zip(worlds.tolist(), rows, found, strict=True):
            episode = {"r": round(float(returns[world]), 6), "l": int(steps[world])}
            episode["t"] = round(time.time() - self._start, 6)
            self._note(episode, metrics)
            more = {"terminal_observation": row, "TimeLimit.truncated": bool(cut[world])}
            infos[world] |= {**metrics, **more, "episode": episode}

    def _note(self, episode: dict[str, Any], metrics: dict[str, float]) -> None:
        """Add the ``Monitor``'s keywords to a row of its file, and write it."""
        if self._monitor is None:
            return
        for name in self._monitor.info_keywords:  # sums alone lack most metrics
            known = name in metrics or name not in EPISODE_METRICS
            episode[name] = metrics[name] if known else math.nan
        if self._monitor.results_writer is not None:
            self._monitor.results_writer.write_row(episode)

    def close(self) -> None:
        """Close the file of the ``Monitor``."""
        self.batch.env.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of the single environment, once for each index."""
        if attr_name in _OF_A_WORLD:
            raise ConfigError(
                f"{attr_name!r} is of one world, and a batch does not have it: expected single "
                "environments, such as with vec_env 'threads'."
            )
        env = self.batch.env
        return [env.get_wrapper_attr(attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise ``ConfigError``: the worlds share their attributes."""
        raise ConfigError(
            f"{attr_name!r} cannot be set in a batch: expected single environments, such as with "
            "vec_env 'threads'."
        )

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the single environment, once for each index."""
        method = self.get_attr(method_name, 0)[0]
        return [method(*args, **kwargs) for _ in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Return whether the single environment has a wrapper, once for each index."""
        found = any(isinstance(layer, wrapper_class) for layer in layers(self.batch.env))
        return [found for _ in self._get_indices(indices)]


def _array(tensor: torch.Tensor) -> np.ndarray:
    array: np.ndarray = tensor.detach().cpu().numpy()
    return array
