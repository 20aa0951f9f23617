"""Recording what a run's saved model plays, as a data set."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy.typing as npt
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from sb3_piano.demonstrations import PerturbedStart
from sb3_piano.exceptions import ConfigError
from sb3_piano.planning import PianoPolicy
from sb3_piano.threads import torch_threads
from sb3_piano.training.algorithms import PLANNERS
from sb3_piano.training.builders import build_planner, build_vec_env
from sb3_piano.training.config import RunConfig
from sb3_piano.training.env_ids import registered_id
from sb3_piano.training.loading import load_player, model_files
from sb3_piano.training.run_folder import RunFolder


class RunPlayer:
    """A run's saved model, with the normalisation that it needs.

    It has the ``predict`` of a model, for observations as the environment gives them.
    """

    def __init__(self, model: BaseAlgorithm | PianoPolicy, venv: VecEnv) -> None:
        self._model = model
        self._normalizer = venv if isinstance(venv, VecNormalize) else None

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: npt.NDArray[Any] | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, Any]:
        """Return what the model plays."""
        if self._normalizer is not None:
            observation = self._normalizer.normalize_obs(observation)
        with torch_threads():
            return self._model.predict(observation, state, episode_start, deterministic)


@contextlib.contextmanager
def run_to_record(
    folder: str | os.PathLike[str], *, best: str | None = None, start: float = 0.0
) -> Iterator[tuple[RunPlayer | PianoPolicy, gym.Env[Any, Any], RunConfig]]:
    """Give a run's player, an environment with the run's wrappers, and its settings.

    They are for :func:`~sb3_piano.demonstrations.record`, as long as the block lasts.

    Args:
        folder: The run's folder.
        best: Play the best model by this metric, in place of the last one.
        start: How far the hands begin out of place, rad (see
            :class:`~sb3_piano.demonstrations.PerturbedStart`).

    Raises:
        ConfigError: If the run's config is damaged, or has wrappers around a vector of
            environments, without which there is no playing.
        RunError: If there is no run, or it has no model that can be loaded.
    """
    run = RunFolder.open(folder)
    config = dataclasses.replace(
        run.read_config(), n_envs=1, vec_env="dummy", monitor_kwargs={}, seed=None
    )
    if config.vec_env_wrapper:
        raise ConfigError(
            f"Run '{run.path}' cannot be recorded: it has {config.vec_env_wrapper[0].path} around "
            "the vector of its environments. Expected no vec_env_wrapper."
        )
    model_file, statistics = model_files(run, config, best)
    with contextlib.ExitStack() as stack:
        env = env_to_record(config, start)
        stack.callback(env.close)
        if config.algo in PLANNERS:  # which play only in the environment that they are made for
            yield build_planner(config, env), env, config
            return
        venv = build_vec_env(config, statistics)
        stack.callback(venv.close)
        yield RunPlayer(load_player(config, model_file, venv), venv), env, config


def env_to_record(config: RunConfig, start: float = 0.0) -> gym.Env[Any, Any]:
    """Return a run's environment with its wrappers, and none that ``gymnasium.make`` cannot make.

    Args:
        config: The run's settings.
        start: How far the hands begin out of place, rad.

    Raises:
        ConfigError: If the environment or a wrapper refuses its arguments.
    """
    env_kwargs = dict(config.env_kwargs)
    try:
        env = gym.spec(registered_id(config.env_id, config.env_module)[1]).make(**env_kwargs)
    except (TypeError, gym.error.Error) as error:
        raise ConfigError(
            f"Environment {config.env_id!r} cannot be made with env_kwargs {env_kwargs}: {error}."
        ) from error
    if start:
        env = PerturbedStart(env, start)
    for plugin in config.env_wrapper:
        env = plugin(env)
    return env
