"""Residual actions on top of a run's model."""

from __future__ import annotations

import copy
import os
from typing import Any, Self

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

from sb3_piano.arrays import Float32Array, FloatArray
from sb3_piano.settings import Positive, checked
from sb3_piano.training.configuration.env_spec import CorrectsRun
from sb3_piano.training.runs.builders import normalized, require_single_agent
from sb3_piano.training.runs.folder import RunFolder
from sb3_piano.training.runs.saved import load_statistics, load_to_play, model_files, predict_single
from sb3_piano.wrappers.hand_actions import change_of_actions
from sb3_piano.wrappers.residual import Residual


class RunResidual(Residual, gym.utils.RecordConstructorArgs, CorrectsRun):
    """Add ``scale`` times the agent's action to the deterministic action of a run's model.

    The sum is clipped to [-1, 1]. Actions of 0 play the model's actions. The agent has one number
    per actuator and none for the pedal, which only the model moves; it has the model's observation.
    The left hand is mirrored, as in :class:`~sb3_piano.wrappers.HandActions`.

    Args:
        env: An environment like the run's, with its wrappers.
        run: The run's folder.
        scale: Change of a finger joint's command by an action of 1, rad, above 0; other actuators
            move a fingertip as far.

    Raises:
        ConfigError: If ``scale`` is out of range, the environment's actions are neither the
            piano's own nor those of :class:`~sb3_piano.wrappers.HandActions`, or the run was no
            training or has another ``vec_env_wrapper`` than HandsAsAgents.
        RunError: If there is no such run, or its model is missing or does not fit the environment.
    """

    def __init__(
        self, env: gym.Env[Any, Any], run: str | os.PathLike[str], scale: float = 0.06
    ) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, run=run, scale=scale)
        rad = checked("scale", scale, Positive)
        super().__init__(env, change_of_actions(env, rad, "RunResidual"))
        self._model, self._venv = _model_of(run, env)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return a copy with a copied environment and the same, read-only model."""
        memo |= {id(shared): shared for shared in (self._model, self._venv)}
        copied = object.__new__(type(self))
        memo[id(self)] = copied
        copied.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return copied

    @property
    def standardization(self) -> tuple[FloatArray, FloatArray]:
        """Mean and standard deviation of the model's observations, (n,) each; else 0 and 1."""
        if not isinstance(self._venv, VecNormalize) or not self._venv.norm_obs:
            size = gym.spaces.flatdim(self._model.observation_space)
            return np.zeros(size), np.ones(size)
        statistics: Any = self._venv.obs_rms
        return statistics.mean, np.sqrt(statistics.var + self._venv.epsilon)

    def base_action(self, observation: Any) -> Float32Array:
        """Return the model's deterministic action."""
        return np.array(predict_single(self._model, self._venv, observation, None, None, True)[0])


def _model_of(run: str | os.PathLike[str], env: gym.Env[Any, Any]) -> tuple[BaseAlgorithm, VecEnv]:
    """Load a run's model for an environment like its own; also return its vector."""
    folder = RunFolder.open(run)
    config = folder.read_config(exported=False)  # who exported it is whose run is played
    refused = f"Run '{folder.path}' cannot be corrected"
    require_single_agent(config, refused)
    model_file, statistics = model_files(folder, config)
    venv: VecEnv = DummyVecEnv([lambda: env])
    for plugin in config.vec_env_wrapper:
        venv = plugin(venv)
    venv = normalized(config, venv)
    load_statistics(config, statistics, venv)
    model = load_to_play(config, model_file, venv)
    model.env = None  # which is this one
    return model, venv
