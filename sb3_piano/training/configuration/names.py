"""Look up algorithms and environments by name."""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

import gymnasium as gym

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.imports import check_package, import_name
from sb3_piano.players import PLAYERS
from sb3_piano.settings import refuse_unknown

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

_ALGORITHMS = {
    "td3": "stable_baselines3.TD3",
    "sac": "stable_baselines3.SAC",
    "ddpg": "stable_baselines3.DDPG",
    "ppo": "stable_baselines3.PPO",
    "a2c": "stable_baselines3.A2C",
    "tqc": "sb3_contrib.TQC",
    "crossq": "sb3_contrib.CrossQ",
    "trpo": "sb3_contrib.TRPO",
}

ALGORITHMS = tuple(_ALGORITHMS)
"""Names of the trainable algorithms, as on the command line."""

PLANNERS = tuple(PLAYERS)
"""Names of the players that need no training."""


def registered_id(env_id: str, module: str | None = None) -> tuple[str | None, str]:
    """Return the module of an environment, if any, and its id.

    The module, named in ``module:Id`` or separately, is imported.
    """
    named, _, name = env_id.rpartition(":")
    module = named or module
    if module:
        check_package(module)
        before, is_new = gym.registry.get(name), module not in sys.modules
        try:
            importlib.import_module(module)
        except Exception as error:  # importing a module may fail in any way
            raise ConfigError(
                f"Module {module!r} of environment {name!r} cannot be imported: {error}."
            ) from error
        if is_new and before is not None and gym.registry.get(name) is before:
            raise ConfigError(
                f"Module {module!r} does not register environment {name!r}, which exists without "
                "it: expected no module, or the one that registers it."
            )
    if name not in gym.registry:
        raise ConfigError(
            f"Unknown environment {name!r}.{near_names(name, gym.registry)} Expected a registered "
            "id, or 'module:Id' to import the module that registers it."
        )
    made = gym.registry[name].entry_point
    where = made if isinstance(made, str) else getattr(made, "__module__", str(made))
    check_package(where.partition(":")[0])
    return module, name


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """Return the stock class of an algorithm."""
    if name in PLANNERS:
        raise ConfigError(
            f"Algorithm {name!r} is not trained, it plays at once: expected 'sb3-piano play PIECE "
            f"--player {name}', or one of {', '.join(ALGORITHMS)}."
        )
    refuse_unknown([name], ALGORITHMS, "algorithm")
    found: type[BaseAlgorithm] = import_name(_ALGORITHMS[name])
    return found
