"""Evaluation environments of callbacks, isolated from the training."""

from __future__ import annotations

import contextlib
import random
import warnings
from collections.abc import Callable, Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecMonitor,
    VecNormalize,
    VecTransposeImage,
    sync_envs_normalization,
    unwrap_vec_normalize,
)
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers
from sb3_piano.vec_env import HandsAsAgents

_REMEDY = "Expected an environment of its own, eval_env=..., or a training by 'sb3-piano train'."

EnvWrapper: TypeAlias = Callable[[gym.Env[Any, Any]], gym.Env[Any, Any]]
"""Function that wraps a bare environment."""


@dataclass(frozen=True, kw_only=True)
class RunContext:
    """The folder of a run, and a factory of environments like its own."""

    folder: Path
    """The run's folder."""
    make_env: Callable[[EnvWrapper | None], VecEnv]
    """Returns one new environment of the run, with all its wrappers, as a vector; the argument is
    put around the bare environment inside."""


class OwnEnvCallback(BaseCallback):
    """Base of callbacks that play in their own environment and leave the training unchanged.

    It is like the first of the training's, made by :meth:`_make_own_env` when a training starts,
    and closed at its end.
    """

    _run: RunContext | None = None
    _own_env: VecEnv | None = None

    def use_run(self, run: RunContext) -> None:
        """Set missing arguments from a run: the environment, and places for files."""
        self._run = run

    def _make_own_env(self, innermost: EnvWrapper | None = None) -> VecEnv:
        """Make the environment again and return it."""
        self._on_training_end()
        self._own_env = make_own_env(self.model, self._run, innermost)
        return self._own_env

    def _on_training_end(self) -> None:
        if self._own_env is not None:
            self._own_env.close()
            self._own_env = None


@runtime_checkable
class UsesRun(Protocol):
    """Protocol of callbacks that need their run before the training starts."""

    def use_run(self, run: RunContext) -> None:
        """Set missing arguments from the run."""


def set_run_context(run: RunContext, callbacks: Iterable[BaseCallback]) -> None:
    """Call ``use_run`` of every callback that has it, at any depth of nesting.

    Callbacks are looked for in ``CallbackList`` and in the events of ``EventCallback`` and
    ``EvalCallback``.
    """
    for callback in with_nested(callbacks):
        if isinstance(callback, UsesRun):
            callback.use_run(run)


def with_nested(callbacks: Iterable[BaseCallback]) -> Iterator[BaseCallback]:
    """Yield callbacks, each before those that it holds."""
    for callback in callbacks:
        yield callback
        yield from with_nested(_nested(callback))


def _nested(callback: BaseCallback) -> list[BaseCallback]:
    children = list(getattr(callback, "callbacks", ()))
    children += [getattr(callback, name, None) for name in ("callback", "callback_on_new_best")]
    return [child for child in children if isinstance(child, BaseCallback)]


def make_own_env(
    model: BaseAlgorithm, run: RunContext | None, innermost: EnvWrapper | None = None
) -> VecEnv:
    """Return one environment like those of the training, as a vector of one.

    A run makes it anew. Without a run it is a copy of the first training environment, which must
    then live in this process. ``innermost`` is put around the bare environment.

    Raises:
        ConfigError: If there is no run and the training's environment cannot be copied.
    """
    training = model.get_env()
    assert training is not None, "a model that is being trained has environments"
    with preserve_random_state(model, None):
        venv = copy_env(training, innermost) if run is None else run.make_env(innermost)
    normalization = unwrap_vec_normalize(venv)
    if normalization is not None:
        normalization.training = False
    return venv


def sync_normalization(model: BaseAlgorithm, venv: VecEnv) -> None:
    """Copy the training's present normalisation into an own environment."""
    training = model.get_env()
    if training is not None and model.get_vec_normalize_env() is not None:
        sync_envs_normalization(training, venv)


@contextlib.contextmanager
def preserve_random_state(model: BaseAlgorithm, seed: int | None) -> Iterator[None]:
    """Context manager that restores the global random generators on exit.

    Inside they start from a seed; ``None`` lets them go on.
    """
    # SB3's replay buffers and action noises draw from numpy's global generator.
    python, numpy = random.getstate(), np.random.get_state()  # noqa: NPY002
    devices = [model.device] if model.device.type == "cuda" else []
    with torch.random.fork_rng(devices):
        try:
            if seed is not None:
                set_random_seed(seed)
            yield
        finally:
            random.setstate(python)
            np.random.set_state(numpy)  # noqa: NPY002


def env_name(venv: VecEnv) -> str:
    """Return the name of the first of the environments, for messages."""
    envs = getattr(venv.unwrapped, "envs", None)
    if envs is None:
        return "the environment"
    spec = envs[0].spec
    return repr(type(envs[0].unwrapped).__name__ if spec is None else spec.id)


def copy_env(venv: VecEnv, innermost: EnvWrapper | None = None) -> VecEnv:
    """Return a copy of the first environment of a vector, as a vector of one.

    It has the same wrappers, but writes no files, and begins with a reset.

    Raises:
        ConfigError: If the environment is in another process, or something in it cannot be copied.
    """
    if isinstance(venv, VecEnvWrapper):
        return _rewrapped(venv, copy_env(venv.venv, innermost))
    if not isinstance(venv, DummyVecEnv):
        raise ConfigError(
            f"An environment in a {type(venv).__name__} cannot be copied for a callback. {_REMEDY}"
        )
    copied = _copy_layers(venv.envs[0], innermost)
    return DummyVecEnv([lambda: copied])


def _rewrapped(wrapper: VecEnvWrapper, venv: VecEnv) -> VecEnv:
    """Return a copy of one wrapper of the training around another vector."""
    if isinstance(wrapper, VecMonitor):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The environment is already wrapped")
            return VecMonitor(venv)  # without the file
    if isinstance(wrapper, VecNormalize):
        normalization = deepcopy(wrapper)  # leaves out its vector
        normalization.set_venv(venv)
        return normalization
    if isinstance(wrapper, VecTransposeImage | HandsAsAgents):
        return type(wrapper)(venv)
    if wrapper.num_envs == 1:
        return _with_vector(wrapper, venv)
    raise ConfigError(
        f"The {type(wrapper).__name__} around the training's {wrapper.num_envs} environments "
        f"cannot be copied for one. {_REMEDY}"
    )


def _with_vector(wrapper: VecEnvWrapper, venv: VecEnv) -> VecEnv:
    """Return a copy of a wrapper around another vector of as many environments."""
    copied: VecEnvWrapper = object.__new__(type(wrapper))  # deepcopy fails at its __getattr__
    memo: dict[int, Any] = {id(wrapper): copied, id(wrapper.venv): venv}
    memo[id(wrapper.class_attributes)] = wrapper.class_attributes
    copied.__dict__.update(_deepcopy(vars(wrapper), memo, type(wrapper)))
    return copied


def _copy_layers(env: gym.Env[Any, Any], innermost: EnvWrapper | None) -> gym.Env[Any, Any]:
    """Return a copy of an environment and its wrappers that writes no files.

    Each ``Monitor`` is replaced by one without a file, in the same place. One is added if there
    was none, so that returns are those of an episode whatever wrappers do.
    """
    memo: dict[int, Any] = {}
    monitors = [layer for layer in layers(env) if isinstance(layer, Monitor)]
    for monitor in reversed(monitors):
        memo[id(monitor)] = Monitor(_deepcopy(monitor.env, memo, type(env.unwrapped)))
    copied = _deepcopy(env, memo, type(env.unwrapped))
    if innermost is not None:
        copied = _with_innermost(copied, innermost)
    return copied if monitors else Monitor(copied)


def _deepcopy(thing: Any, memo: dict[int, Any], kind: type) -> Any:
    """Deep-copy an environment; raise an error that names an object without a copy."""
    try:
        return deepcopy(thing, memo)
    except (TypeError, ValueError, AttributeError, NotImplementedError) as error:
        raise ConfigError(
            f"The training's {kind.__name__} cannot be copied ({error}). {_REMEDY}"
        ) from error


def _with_innermost(env: gym.Env[Any, Any], innermost: EnvWrapper) -> gym.Env[Any, Any]:
    *_, last = [None, *(layer for layer in layers(env) if isinstance(layer, gym.Wrapper))]
    if last is None:
        return innermost(env)
    last.env = innermost(last.env)
    return env
