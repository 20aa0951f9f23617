"""Gymnasium vector environment of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from sb3_piano.batch.environment import BatchedPiano
from sb3_piano.batch.thread_vector_env import PianoVectorEnv, checked_mode
from sb3_piano.envs.score_choice import ScoreSource
from sb3_piano.exceptions import ConfigError


class BatchVectorEnv(VectorEnv[Any, Any, Any]):
    """Gymnasium vector environment of a :class:`BatchedPiano`.

    ``gymnasium.make_vec(id, num_envs, "vector_entry_point", backend="cpu")`` makes one.

    Args:
        num_envs: Number of worlds.
        score: Score or scores, see :class:`BatchedPiano`.
        autoreset_mode: When a world whose episode has ended starts the next one.
        tensors: Whether to return observations, rewards and ends as tensors on the worlds' device.
        **options: Options of :class:`BatchedPiano`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        score: ScoreSource | Sequence[ScoreSource] = "TwinkleTwinkleLittleStar",
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        tensors: bool = False,
        **options: Any,
    ) -> None:
        mode = checked_mode(autoreset_mode)
        self.batch = BatchedPiano(num_envs, score, **options)
        """The batched pianos."""
        self.num_envs = self.batch.num_envs
        piano = self.batch.piano
        self.metadata = {**piano.metadata, "autoreset_mode": mode}
        self._mode, self._tensors = mode, tensors
        self.single_observation_space = self.batch.observation_space
        self.single_action_space = self.batch.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended = torch.zeros(self.num_envs, dtype=torch.bool, device=self.batch.device)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in every world, or in the worlds of the option ``"reset_mask"``."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        if options:
            raise ConfigError(
                f"Unknown reset option {next(iter(options))!r}: expected 'reset_mask'."
            )
        if seed is not None:
            self.batch.seed(seed)
        mask = None if mask is None else torch.as_tensor(mask)
        observation = self.batch.reset(mask)
        self._ended = torch.zeros_like(self._ended) if mask is None else self._ended & ~mask
        return self._given(observation), {}

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Simulate one control step in every world, or reset worlds whose episode has ended."""
        before, batch = self._ended, self.batch
        observation, reward, terminated, truncated = batch.step(torch.as_tensor(actions))
        infos: dict[str, Any] = {}
        if self._mode == AutoresetMode.NEXT_STEP and before.any():
            observation = batch.reset(before)
            reward = torch.where(before, 0.0, reward)
            terminated, truncated = terminated & ~before, truncated & ~before
        self._ended = terminated | truncated
        worlds = self._ended.nonzero().flatten().tolist()
        same = self._mode == AutoresetMode.SAME_STEP
        found = self.batch.summaries(worlds) if worlds else []
        for world, metrics in zip(worlds, found, strict=True):
            final = {"final_obs": observation[world].cpu().numpy(), "final_info": metrics}
            infos = self._add_info(infos, final if same else metrics, world)
        if worlds and same:
            observation = batch.reset(self._ended)
        given = (self._given(one) for one in (observation, reward, terminated, truncated))
        return (*given, infos)

    def close_extras(self, **kwargs: Any) -> None:
        """Do nothing: memory is freed with the object."""

    def _given(self, tensor: torch.Tensor) -> Any:
        return tensor if self._tensors else tensor.cpu().numpy()


def make_vector_env(
    *args: Any, backend: str | None = None, **options: Any
) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Create a vector environment for ``gymnasium.make_vec``: a batch, or threads by default.

    Args:
        *args: Number of environments and score.
        backend: "cpu" or "warp", see :class:`BatchedPiano`; ``None`` for single environments in
            threads, a :class:`~sb3_piano.batch.PianoVectorEnv`.
        **options: Options of the vector environment's class.
    """
    if backend is None:
        return PianoVectorEnv(*args, **options)
    return BatchVectorEnv(*args, backend=backend, **options)
