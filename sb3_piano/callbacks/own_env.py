"""An environment in which a callback plays, so that the training does not notice."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import (
    VecEnv,
    sync_envs_normalization,
    unwrap_vec_normalize,
)

from sb3_piano.callbacks.env_copy import copy_env
from sb3_piano.callbacks.run_context import EnvWrapper, RunContext


def make_own_env(
    model: BaseAlgorithm, run: RunContext | None, innermost: EnvWrapper | None = None
) -> VecEnv:
    """Return one environment like those of the training, as a vector of one.

    A run makes it anew. Without a run it is a copy of the first training environment, which must
    then live in this process.

    Args:
        model: The model that is being trained.
        run: The run, if its session told the callback.
        innermost: A wrapper for the bare environment.

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
    """Let an environment of :func:`make_own_env` normalise as the training does now."""
    training = model.get_env()
    if training is not None and model.get_vec_normalize_env() is not None:
        sync_envs_normalization(training, venv)


@contextlib.contextmanager
def preserve_random_state(model: BaseAlgorithm, seed: int | None) -> Iterator[None]:
    """Give back the global random generators as they were, whatever draws from them meanwhile.

    Args:
        model: Its device tells whether a GPU has a generator, too.
        seed: What the generators start from inside; ``None`` lets them go on.
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
    """Return what the first of the environments is called, for messages."""
    envs = getattr(venv.unwrapped, "envs", None)
    if envs is None:
        return "the environment"
    spec = envs[0].spec
    return repr(type(envs[0].unwrapped).__name__ if spec is None else spec.id)
