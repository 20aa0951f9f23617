"""From a config to environments and a model."""

from __future__ import annotations

import os
import pickle
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.noise import (
    ActionNoise,
    NormalActionNoise,
    OrnsteinUhlenbeckActionNoise,
)
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv, VecNormalize

from sb3_piano.buffers.rows import buffer_rows
from sb3_piano.exceptions import ConfigError, RunError, one_line
from sb3_piano.planning import PianoPolicy
from sb3_piano.training.algorithms import planner_class
from sb3_piano.training.coerce import (
    accepts_schedule,
    check_arguments,
    classes_made,
    dataclass_made,
    linear_start,
    parameters_of,
)
from sb3_piano.training.config import RunConfig
from sb3_piano.training.env_ids import registered_id
from sb3_piano.training.episode_log import EpisodeLog
from sb3_piano.training.import_names import import_class
from sb3_piano.training.weights import (
    WEIGHTS_FILE,
    Tensors,
    normalization_tensors,
    put_normalization,
    read_weights,
)
from sb3_piano.vec_env import ThreadVecEnv

EnvWrapper = Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]

_VEC_ENV_CLASSES: dict[str, type[DummyVecEnv] | type[SubprocVecEnv]] = {
    "dummy": DummyVecEnv,
    "threads": ThreadVecEnv,
    "subproc": SubprocVecEnv,
}


def build_vec_env(
    config: RunConfig,
    statistics: Path | None = None,
    innermost: EnvWrapper | None = None,
) -> VecEnv:
    """Return the vector of environments of a run.

    From the inside: the environment, ``innermost``, ``Monitor``, an ``EpisodeLog``, the config's
    ``env_wrapper``; then ``vec_env_wrapper`` and ``VecNormalize`` around the vector.

    Args:
        config: The run's settings.
        statistics: The file with what ``VecNormalize`` begins with, pickled or plain arrays.
        innermost: A wrapper for the bare environment.

    Raises:
        ConfigError: If the environment or a wrapper refuses its arguments.
        RunError: If the statistics cannot be loaded.
    """
    spec = gym.spec(registered_id(config.env_id, config.env_module)[1])
    env_kwargs = dict(config.env_kwargs)
    info_keywords = config.monitor_kwargs.get("info_keywords", ())
    training_process = os.getpid()

    def make() -> gym.Env[Any, Any]:
        if os.getpid() != training_process:
            # Ctrl-C reaches the whole process group; it is for the training alone to answer it.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
        env: gym.Env[Any, Any] = spec.make(**env_kwargs)
        return env if innermost is None else innermost(env)

    def wrap(env: gym.Env[Any, Any]) -> gym.Env[Any, Any]:
        env = EpisodeLog(env, info_keywords)
        for plugin in config.env_wrapper:
            env = plugin(env)
        return env

    vec_env_cls = _VEC_ENV_CLASSES[config.vec_env]
    subproc = vec_env_cls is SubprocVecEnv
    try:
        if subproc:
            wrap(make()).close()  # what is wrong is easier told from here than from a process
        venv = make_vec_env(
            make,
            n_envs=config.n_envs,
            seed=config.seed,
            wrapper_class=wrap,
            vec_env_cls=vec_env_cls,
            # fork is not safe in a process with threads, such as torch's
            vec_env_kwargs={"start_method": "spawn"} if subproc else {},
            monitor_kwargs=dict(config.monitor_kwargs),
        )
    except (TypeError, gym.error.Error) as error:
        raise ConfigError(
            f"Environment {config.env_id!r} cannot be made with env_kwargs {env_kwargs}: {error}."
        ) from error
    for plugin in config.vec_env_wrapper:
        venv = plugin(venv)
    return _normalized(config, venv, statistics)


def build_model(config: RunConfig, venv: VecEnv) -> BaseAlgorithm:
    """Return the new model of a run, on its environments.

    Raises:
        ConfigError: If the algorithm refuses its arguments or the environment.
        RunError: If its replay buffer cannot be saved.
    """
    arguments = algorithm_arguments(config)
    noise = _action_noise(config, venv)
    if noise is not None:
        arguments["action_noise"] = noise
    policy = import_class(config.policy, BasePolicy) if "." in config.policy else config.policy
    try:
        model = config.algorithm(policy=policy, env=venv, seed=config.seed, **arguments)
    # How SB3 and torch refuse arguments, or a device or the memory that they ask for.
    except (TypeError, ValueError, AssertionError, RuntimeError, MemoryError) as error:
        raise ConfigError(
            f"{config.algorithm.__name__} cannot be made for {config.env_id!r}: {error}"
        ) from error
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        buffer_rows(buffer)
    return model


def build_planner(config: RunConfig, env: gym.Env[Any, Any] | VecEnv) -> PianoPolicy:
    """Return what plays without training, in the environments that it is for.

    Raises:
        ConfigError: If it refuses its arguments or the environment.
    """
    made = planner_class(config.algo)
    parameters = parameters_of(made)
    arguments = {
        name: dataclass_made(value, parameters[name].annotation)
        for name, value in check_arguments(config.algorithm_kwargs, made).items()
    }
    if "seed" in parameters:
        arguments["seed"] = config.seed or 0
    return made(env, **arguments)


def build_callbacks(config: RunConfig) -> list[BaseCallback]:
    """Return the callbacks that the config names.

    Raises:
        ConfigError: If one refuses its arguments.
    """
    return [plugin() for plugin in config.callback]


def algorithm_arguments(config: RunConfig) -> dict[str, Any]:
    """Return the arguments of the algorithm's constructor with classes and schedules made."""
    parameters = parameters_of(config.algorithm)
    arguments = check_arguments(config.algorithm_kwargs, config.algorithm)
    for name, value in arguments.items():
        start = linear_start(value)
        if start is not None and accepts_schedule(parameters[name].annotation):
            arguments[name] = LinearSchedule(start, 0.0, 1.0)
        else:
            arguments[name] = classes_made(value, name)
    return arguments


def _action_noise(config: RunConfig, venv: VecEnv) -> ActionNoise | None:
    if config.noise_type is None or config.noise_std is None:
        return None
    if not isinstance(venv.action_space, gym.spaces.Box):
        raise ConfigError(
            f"noise_type is {config.noise_type!r}, but {config.env_id!r} has the action space "
            f"{venv.action_space}: expected a Box, or no noise_type."
        )
    mean = np.zeros(venv.action_space.shape)
    sigma = np.full(venv.action_space.shape, config.noise_std)
    kinds = {"normal": NormalActionNoise, "ornstein-uhlenbeck": OrnsteinUhlenbeckActionNoise}
    return kinds[config.noise_type](mean=mean, sigma=sigma)


def _normalized(config: RunConfig, venv: VecEnv, statistics: Path | None) -> VecEnv:
    if statistics is None and config.normalize is False:
        return venv
    arguments = {} if isinstance(config.normalize, bool) else dict(config.normalize)
    gamma = config.algorithm_kwargs.get("gamma")
    if gamma is not None:
        arguments.setdefault("gamma", gamma)
    normalizer = VecNormalize(venv, **arguments)
    if statistics is not None:
        try:
            put_normalization(_saved_statistics(config, statistics), normalizer)
        except ValueError as error:
            raise RunError(
                f"Statistics '{statistics}' cannot be loaded ({error}): expected those of "
                f"VecNormalize for {config.env_id!r}."
            ) from error
    return normalizer


def _saved_statistics(config: RunConfig, path: Path) -> Tensors:
    """Return what a file has, of plain arrays or a pickled ``VecNormalize``.

    Raises:
        RunError: If a file of plain arrays is damaged.
        ValueError: If a pickled one is.
    """
    if path.name == WEIGHTS_FILE:
        return read_weights(path, config)[0]
    try:
        with path.open("rb") as file:
            return normalization_tensors(pickle.load(file))
    except Exception as error:  # unpickling fails in any way
        raise ValueError(one_line(error)) from error
