"""Saved models."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import Any

from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from sb3_piano.exceptions import RunError
from sb3_piano.training.config import RunConfig

_REFUSALS = (
    OSError,
    ValueError,
    KeyError,
    AttributeError,
    ImportError,
    RuntimeError,
    pickle.UnpicklingError,
    zipfile.BadZipFile,
)


def load_model(config: RunConfig, path: Path, venv: VecEnv, **changes: Any) -> BaseAlgorithm:
    """Return a saved model on the given environments.

    Args:
        config: The run's settings.
        path: The model's zip file. Like all of SB3's it is unpickled: load only what you trust.
        venv: Environments with the spaces that the model was trained in.
        **changes: Attributes of the model to set before its networks and buffers are made.

    Raises:
        RunError: If the file is missing or damaged, or does not fit algorithm and environments.
    """
    device = config.algorithm_kwargs.get("device", "auto")
    try:
        return config.algorithm.load(path, env=venv, device=device, **changes)
    except _REFUSALS as error:
        raise RunError(
            f"Model '{path}' cannot be loaded ({error}): expected a model that "
            f"{config.algorithm.__name__} saved for {config.env_id!r}."
        ) from error
