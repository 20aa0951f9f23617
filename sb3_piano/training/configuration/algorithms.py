"""The algorithms, imported only when asked for."""

from __future__ import annotations

import importlib

from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.planning import PianoPolicy

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

_PLANNERS = {
    "planned": ("sb3_piano.planning", "PlannedPianist"),
    "sampling": ("sb3_piano.planning.sampling", "PredictiveSampling"),
}

ALGORITHMS = tuple(_MODULES)
"""Names of the algorithms that are trained, as on the command line."""

PLANNERS = tuple(_PLANNERS)
"""Names of what plays without training."""


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """Return the stock class of an algorithm.

    Raises:
        ConfigError: If the name is unknown, or of what is not trained.
        ImportError: If its package is not installed.
    """
    if name in PLANNERS:
        raise ConfigError(
            f"Algorithm {name!r} is not trained, it plays at once: expected 'sb3-piano plan', "
            f"which makes a run of it, or one of {', '.join(ALGORITHMS)}."
        )
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


def planner_class(name: str) -> type[PianoPolicy]:
    """Return the class of what plays without training.

    Args:
        name: One of :data:`PLANNERS`.
    """
    module, class_name = _PLANNERS[name]
    found: type[PianoPolicy] = getattr(importlib.import_module(module), class_name)
    return found
