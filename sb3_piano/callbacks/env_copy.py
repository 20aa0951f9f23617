"""A copy of an environment that is in use."""

from __future__ import annotations

import warnings
from copy import deepcopy
from typing import Any

import gymnasium as gym
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecMonitor,
    VecNormalize,
    VecTransposeImage,
)
from stable_baselines3.common.vec_env.base_vec_env import VecEnvWrapper

from sb3_piano.callbacks.run_context import EnvWrapper
from sb3_piano.exceptions import ConfigError
from sb3_piano.layers import layers

_REMEDY = "Expected an environment of its own, eval_env=..., or a training by 'sb3-piano train'."


def copy_env(venv: VecEnv, innermost: EnvWrapper | None = None) -> VecEnv:
    """Return a copy of the first environment of a vector, as a vector of one.

    It has the same wrappers, but writes no files, and begins with a reset.

    Args:
        venv: A ``DummyVecEnv`` or ``ThreadVecEnv``, with or without wrappers.
        innermost: A wrapper for the bare environment of the copy.

    Raises:
        ConfigError: If the environment is in another process, or something in it cannot be copied.
    """
    if isinstance(venv, VecEnvWrapper):
        return _rewrapped(venv, copy_env(venv.venv, innermost))
    if not isinstance(venv, DummyVecEnv):
        raise ConfigError(
            f"The training's environments are in a {type(venv).__name__}, out of which none can be "
            f"copied. {_REMEDY}"
        )
    copied = _copy_layers(venv.envs[0], innermost)
    return DummyVecEnv([lambda: copied])


def _rewrapped(wrapper: VecEnvWrapper, venv: VecEnv) -> VecEnv:
    """Return a copy of one wrapper of the training around another vector."""
    if isinstance(wrapper, VecMonitor):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "The environment is already wrapped")
            return VecMonitor(venv)  # without the file
    if isinstance(wrapper, VecTransposeImage):
        return VecTransposeImage(venv)
    if isinstance(wrapper, VecNormalize):
        normalization = deepcopy(wrapper)  # leaves out its vector
        normalization.set_venv(venv)
        return normalization
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
    """Return a copy.

    Raises:
        ConfigError: If something in it, such as an open file or a window, cannot be copied.
    """
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
