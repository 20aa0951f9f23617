"""The algorithms that can be trained, imported only when asked for."""

from __future__ import annotations

import importlib

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.exceptions import ConfigError, near_names

_MODULES = {
    "td3": ("stable_baselines3", "TD3"),
    "sac": ("stable_baselines3", "SAC"),
    "ddpg": ("stable_baselines3", "DDPG"),
    "ppo": ("stable_baselines3", "PPO"),
    "a2c": ("stable_baselines3", "A2C"),
    "tqc": ("sb3_contrib", "TQC"),
    "crossq": ("sb3_contrib", "CrossQ"),
    "trpo": ("sb3_contrib", "TRPO"),
}

ALGORITHMS = tuple(_MODULES)
"""Names of the algorithms, as on the command line."""


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """Return the stock class of an algorithm.

    Raises:
        ConfigError: If the name is unknown.
        ImportError: If its package is not installed.
    """
    if name not in _MODULES:
        raise ConfigError(
            f"Unknown algorithm {name!r}.{near_names(str(name), ALGORITHMS)} Expected one of "
            f"{', '.join(ALGORITHMS)}."
        )
    module, class_name = _MODULES[name]
    try:
        found: type[BaseAlgorithm] = getattr(importlib.import_module(module), class_name)
    except ModuleNotFoundError as error:
        package = module.replace("_", "-")
        raise ImportError(f"{class_name} needs {package}: pip install {package}") from error
    return found
