"""Build environments, model and callbacks from a config."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor, ResultsWriter
from stable_baselines3.common.noise import (
    ActionNoise,
    NormalActionNoise,
    OrnsteinUhlenbeckActionNoise,
)
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.preprocessing import (
    is_image_space,
    is_image_space_channels_first,
)
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecNormalize,
    VecTransposeImage,
)

from sb3_piano.buffers.rows import buffer_rows
from sb3_piano.callbacks.own_env import EnvWrapper
from sb3_piano.envs import PianoEnv
from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.imports import import_class, import_name
from sb3_piano.interrupts import leave_to_parent
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.env_spec import Env
from sb3_piano.training.configuration.values import (
    classes_made,
    linear_start,
)
from sb3_piano.vec_env import HandsAsAgents, ProcessVecEnv, ThreadVecEnv

_FEWEST_DRAWS = 256
"""Scores that a batch draws beforehand where a wrapper draws them."""


class EpisodeLog(Monitor):
    """SB3's ``Monitor`` with a file opened later, also in another process.

    The run's folder does not exist until environment and model work.
    """

    def count_on(self, steps: int) -> None:
        """Set the number of control steps done so far, here and in the environment."""
        self.total_steps = steps  # a vector's get_attr reads this one
        if isinstance(self.unwrapped, PianoEnv):
            self.unwrapped.total_steps = steps

    def write_episodes_to(self, path: str, append: bool) -> None:
        """Write each finished episode to a file; append to or replace former episodes.

        When appending, the file's start time is kept, as SB3 sorts episodes by time.
        """
        file = Path(f"{path}.{Monitor.EXT}")
        append = append and file.is_file()
        if append:
            with contextlib.suppress(ValueError, KeyError, OSError), file.open() as lines:
                self.t_start = float(json.loads(lines.readline()[1:])["t_start"])
        env_id = None if self.env.spec is None else self.env.spec.id
        self.results_writer = _EpisodeFile(
            path,
            header={"t_start": self.t_start, "env_id": str(env_id)},
            extra_keys=self.info_keywords,
            override_existing=not append,
        )


class _EpisodeFile(ResultsWriter):
    """Results file that tolerates a full disk.

    Unwritten rows stay in the file's buffer until the next row. The environment's process goes
    on; if the disk stays full, the checkpoint raises the error.
    """

    def write_row(self, epinfo: dict[str, float]) -> None:
        with contextlib.suppress(OSError):
            super().write_row(epinfo)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            super().close()


def build_vec_env(config: RunConfig, innermost: EnvWrapper | None = None) -> VecEnv:
    """Build the vector of environments of a run.

    From the inside: the environment, ``innermost``, an ``EpisodeLog``, the config's
    ``env_wrapper``; then ``vec_env_wrapper`` and ``VecNormalize`` around the vector.
    """
    log = partial(EpisodeLog, **config.monitor_kwargs)
    venv = _batch(config, innermost, log) if config.is_batched else _vector(config, innermost, log)
    venv.seed(config.seed)
    for plugin in config.vec_env_wrapper:
        venv = plugin(venv)
    return normalized(config, venv)


def _batch(config: RunConfig, *innermost: EnvWrapper | None) -> VecEnv:
    """Build the batch of a run; all worlds write to one ``EpisodeLog``."""
    from sb3_piano.batch import BatchedPiano, BatchVecEnv  # takes as long as SB3

    env, draws = config.env.make(*innermost), _FEWEST_DRAWS
    if len(config.pieces) > 1:
        env.get_wrapper_attr("play_in_turn")()  # so that no piece is left out
        draws = len(config.pieces) * math.ceil(draws / len(config.pieces))
    warp, device = config.vec_env == "warp", config.algorithm_kwargs.get("device", "auto")
    # All metrics of an episode take longer than its physics on a GPU.
    pianos = BatchedPiano(
        config.n_envs,
        env=env,
        backend="warp" if warp else "cpu",
        device=str(device) if warp and device != "auto" else None,
        metrics="sums" if warp else "all",
        draws=draws,
        seed=config.seed,
    )
    return BatchVecEnv(pianos)


def _vector(config: RunConfig, *innermost: EnvWrapper | None) -> VecEnv:
    """Build the vector of single environments of a run."""
    training_process = os.getpid()
    specs = [config.env.of_env(rank, config.n_envs) for rank in range(config.n_envs)]

    def make(rank: int) -> Env:
        if os.getpid() != training_process:
            leave_to_parent()
        env = specs[rank].make(*innermost)
        if config.seed is not None:
            env.unwrapped.action_space.seed(config.seed + rank)
        return env

    makers: list[Callable[[], Env]] = [partial(make, rank) for rank in range(config.n_envs)]
    kinds: dict[str, Callable[[list[Callable[[], Env]]], VecEnv]] = {
        "dummy": DummyVecEnv,
        "threads": ThreadVecEnv,
        "processes": ProcessVecEnv,
        # Not SB3's SubprocVecEnv, which waits forever for a killed process.
        "subproc": partial(ProcessVecEnv, n_processes=config.n_envs),
    }
    venv = kinds[config.vec_env](makers)
    if config.pieces:
        _check_same_observations(config, venv)
    return venv


def _check_same_observations(config: RunConfig, venv: VecEnv) -> None:
    """Close the environments and raise ConfigError if their observations differ.

    Equal spaces may show different keys if both leave out equally many, so columns are compared.
    """
    first, *others = venv.get_attr("observation_space")
    for index, space in enumerate(others, start=1):
        piece, its = config.pieces[index % len(config.pieces)], repr(config.pieces[0])
        if space != first:
            found = f"the observation is {space}, with {its} {first}"
        elif _columns(space) != _columns(first):
            found = f"the observation shows other keys than with {its}"
        else:
            continue
        venv.close()
        raise ConfigError(
            f"With the piece {piece!r} {found}: expected wrappers that do not depend on the piece."
        )


def _columns(space: Any) -> list[list[int]]:
    """Return the columns of each block of an observation space, if it has blocks."""
    return [block.all_columns.tolist() for block in getattr(space, "layout", {}).values()]


def require_single_agent(config: RunConfig, what: str) -> None:
    """Check that a run's model acts on the observation of a single environment.

    Raises:
        ConfigError: If its ``vec_env_wrapper`` is another than HandsAsAgents; ``what`` begins the
            message.
    """
    for plugin in config.vec_env_wrapper:
        if import_name(plugin.path) is not HandsAsAgents:
            raise ConfigError(
                f"{what}: it has {plugin.path} around the vector of its environments. Expected no "
                "vec_env_wrapper, or sb3_piano.vec_env.HandsAsAgents alone."
            )


def build_model(config: RunConfig, venv: VecEnv) -> BaseAlgorithm:
    """Build a new model of a run on its environments."""
    arguments = algorithm_arguments(config)
    noise = _action_noise(config, venv)
    if noise is not None:
        arguments["action_noise"] = noise
    policy = import_class(config.policy, BasePolicy) if "." in config.policy else config.policy
    try:
        model = config.algorithm(policy=policy, env=venv, seed=config.seed, **arguments)
    # SB3 and torch reject arguments, devices and memory sizes with these.
    except (TypeError, ValueError, AssertionError, RuntimeError, MemoryError) as error:
        raise ConfigError(
            f"{config.algorithm.__name__} cannot be made for {config.env_id!r}: {one_line(error)}"
        ) from error
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        buffer_rows(buffer)
    return model


def build_callbacks(config: RunConfig) -> list[BaseCallback]:
    """Build the callbacks of the config."""
    return [plugin() for plugin in config.callback]


def algorithm_arguments(config: RunConfig) -> dict[str, Any]:
    """Return the arguments of the algorithm's constructor, with classes and schedules."""
    arguments = {}
    for name, value in config.algorithm_kwargs.items():
        start = linear_start(value)
        made = classes_made(value, name) if start is None else LinearSchedule(start, 0.0, 1.0)
        arguments[name] = made
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


def normalized(config: RunConfig, venv: VecEnv) -> VecEnv:
    """Wrap environments in ``VecNormalize`` if the config normalises."""
    if config.normalize is False:
        return venv
    arguments = {} if isinstance(config.normalize, bool) else dict(config.normalize)
    gamma = config.algorithm_kwargs.get("gamma")
    if gamma is not None:
        arguments.setdefault("gamma", gamma)
    shown = getattr(venv.observation_space, "spaces", {}).values()
    if any(is_image_space(one) and not is_image_space_channels_first(one) for one in shown):
        # SB3 would add it outside VecNormalize, whose original observations do not fit it.
        venv = VecTransposeImage(venv)
    return VecNormalize(venv, **arguments)
