"""Residual actions: corrections of a run's model by an agent that learns on."""

from __future__ import annotations

import os
from typing import Any, SupportsFloat

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError, InvalidActionError
from sb3_piano.settings import Positive, checked
from sb3_piano.training.configuration.config import CorrectsRun, RunConfig
from sb3_piano.training.runs.builders import normalized
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import load_player, load_statistics, model_files
from sb3_piano.wrappers.hand_actions import CorrectsHandActions, hand_actions_of
from sb3_piano.wrappers.piano import piano_of


class RunResidual(
    gym.Wrapper[Any, Any, Any, Any],
    gym.utils.RecordConstructorArgs,
    CorrectsHandActions,
    CorrectsRun,
):
    """Let the model of a run play, and the agent correct it.

    What is played is the model's action, without exploring, plus the agent's times ``scale``, cut
    at -1 and 1. Actions of 0 play as the model does. The agent has a number for each actuator and
    none for the pedal, which the model alone moves; it observes what the model does.

    Wrappers inside of this one are those of the run; they get what is played.

    Source: residual policies (Silver et al. 2018, "Residual Policy Learning"; Johannink et al.
    2019, "Residual Reinforcement Learning for Robot Control").

    Args:
        env: An environment like that of the run, with its wrappers.
        run: The run's folder.
        scale: By how much an action of 1 moves the command of a finger's joint, rad, above 0; other
            actuators as far as moves a fingertip as much.

    Raises:
        ConfigError: If ``scale`` is out of range, or the environment has other actions than the
            piano's own or those of :class:`~sb3_piano.wrappers.HandActions`.
        RunError: If there is no such run, it has no model, or that does not fit the environment.
    """

    def __init__(
        self, env: gym.Env[Any, Any], run: str | os.PathLike[str], scale: float = 0.06
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, run=run, scale=scale)
        super().__init__(env)
        piano, rad = piano_of(env, "RunResidual"), checked("scale", scale, Positive)
        if env.action_space == piano.action_space:
            reach = piano.action_map.change(rad * piano.scene.actuator_unit)
        else:
            inside = hand_actions_of(env, "RunResidual")
            if env.action_space != inside.action_space:
                raise ConfigError(
                    f"RunResidual cannot correct actions of {env.action_space}: expected the "
                    f"piano's own, {piano.action_space}, or those of HandActions."
                )
            reach = np.full(inside.reach.shape, rad / np.abs(inside.reach).max())
        self._reach = reach.astype(np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, self._reach.shape, dtype=np.float32)
        self._model, self._normalizer = _model_of(run, env)
        self._seen: Any = None

    @property
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation, (n,), by which the model takes observations, or 0 and 1."""
        if self._normalizer is None:
            size = gym.spaces.flatdim(self.observation_space)
            return np.zeros(size), np.ones(size)
        statistics: Any = self._normalizer.obs_rms
        return statistics.mean, np.sqrt(statistics.var + self._normalizer.epsilon)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._seen, info = self.env.reset(seed=seed, options=options)
        return self._seen, info

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Play a control step of the model's, corrected.

        Raises:
            InvalidActionError: If the action has the wrong shape.
        """
        correction = np.asarray(action, dtype=np.float32)
        if correction.shape != self._reach.shape:
            raise InvalidActionError(
                f"The action has shape {correction.shape}: expected {self._reach.shape}, one "
                "number for each actuator and none for the pedal."
            )
        seen = self._seen
        if self._normalizer is not None:
            seen = self._normalizer.normalize_obs(seen)
        played = np.array(self._model.predict(seen, deterministic=True)[0])
        played[: len(correction)] += self._reach * np.minimum(np.maximum(correction, -1.0), 1.0)
        self._seen, *result = self.env.step(np.minimum(np.maximum(played, -1.0), 1.0))
        return self._seen, *result


def _model_of(
    run: str | os.PathLike[str], env: gym.Env[Any, Any]
) -> tuple[BaseAlgorithm, VecNormalize | None]:
    """Return the model of a run for an environment like its own, and what normalises for it."""
    folder = RunFolder.open(run)
    config = folder.read_config()
    if not isinstance(config, RunConfig) or config.vec_env_wrapper:
        raise ConfigError(
            f"Run '{folder.path}' cannot be corrected: expected a training without vec_env_wrapper."
        )
    model_file, statistics = model_files(folder, config)
    venv = normalized(config, DummyVecEnv([lambda: env]))
    load_statistics(config, statistics, venv)
    model = load_player(config, model_file, venv)
    assert isinstance(model, BaseAlgorithm), "it was trained"
    model.env = None  # which is this one
    return model, venv if isinstance(venv, VecNormalize) else None
