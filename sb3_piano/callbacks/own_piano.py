"""A piano of a callback's own, which records what the model plays on it."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import TimeLimit
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.callbacks.own_env import (
    env_name,
    make_own_env,
    preserve_random_state,
    sync_normalization,
)
from sb3_piano.callbacks.run_context import RunContext
from sb3_piano.envs import EpisodeRecorder, PianoEnv
from sb3_piano.exceptions import ConfigError
from sb3_piano.viewing import Take


class OwnPiano:
    """An environment like those of the training, in which the model plays single episodes.

    Args:
        model: The model that is being trained.
        run: The run, if its session told the callback.
        max_seconds: After which time an episode is cut off, s.

    Raises:
        ConfigError: If the environment is no piano, or there is no run and it cannot be copied.
    """

    def __init__(self, model: BaseAlgorithm, run: RunContext | None, max_seconds: float) -> None:
        self._model = model
        self._max_seconds = max_seconds
        recorders: list[EpisodeRecorder] = []

        def record(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
            recorders.append(EpisodeRecorder(self._cut_off(env)))
            return recorders[-1]

        self._env = make_own_env(model, run, record)
        self._recorder = recorders[-1]
        piano = self._recorder.unwrapped
        if not isinstance(piano, PianoEnv):
            self.close()
            raise ConfigError(
                f"There is no performance to record in {env_name(self._env)}: expected a piano "
                "environment."
            )
        self._scene = piano.scene

    def play(self, seed: int | None) -> Take:
        """Return an episode that the model plays now, without exploring.

        Args:
            seed: Seeds the environment; ``None`` lets it go on from the last episode.
        """
        sync_normalization(self._model, self._env)
        with preserve_random_state(self._model, seed):
            if seed is not None:
                self._env.seed(seed)
            self._play_on()
        recording = self._recorder.finished.pop()
        assert recording.performance is not None, "it is a piano"
        assert recording.motion is not None, "it is a piano"
        return Take.of(self._scene, recording.performance, recording.motion.qpos)

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def _cut_off(self, env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        """End the episodes of a piano after the longest time."""
        if not isinstance(env.unwrapped, PianoEnv):
            return env
        steps = int(self._max_seconds / env.unwrapped.config.control_timestep + 1e-9)
        return TimeLimit(env, max(steps, 1))

    def _play_on(self) -> None:
        observation: Any = self._env.reset()
        state, starts = None, np.ones(1, dtype=bool)
        while not self._recorder.finished:
            action, state = self._model.predict(observation, state, starts, deterministic=True)
            observation, _, starts, _ = self._env.step(action)
