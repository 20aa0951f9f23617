"""Classes, algorithms and environments that configurations name by text."""

from __future__ import annotations

import importlib
import re
import sys
from types import ModuleType
from typing import Any

import gymnasium as gym
from stable_baselines3.common.base_class import BaseAlgorithm

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.planning import PianoPolicy

_ALGORITHMS = {
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

ALGORITHMS = tuple(_ALGORITHMS)
"""Names of the algorithms that are trained, as on the command line."""

PLANNERS = tuple(_PLANNERS)
"""Names of what plays without training."""

_DOTTED = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)+")

# The short names that RL Zoo has in scope when it evaluates text from its YAML files.
_ZOO_NAMES = {
    "nn": "torch.nn",
    "th": "torch",
    "sb3": "stable_baselines3",
    "HerReplayBuffer": "stable_baselines3.HerReplayBuffer",
    "RMSpropTFLike": "stable_baselines3.common.sb2_compat.rmsprop_tf_like.RMSpropTFLike",
}

# How text that RL Zoo evaluates can name what is not in its scope.
_ZOO_IMPORT = re.compile(r"""importlib\.import_module\((['"])([\w.]+)\1\)\.([\w.]+)""")


def is_dotted(text: str) -> bool:
    """Return whether a text could be an import path, such as ``torch.nn.ReLU``."""
    return _DOTTED.fullmatch(text) is not None


def full_name(name: str) -> str:
    """Return the import path that stands for the Zoo's ways to name a thing.

    ``nn.ReLU`` becomes ``torch.nn.ReLU``, ``importlib.import_module('a.b').C`` becomes ``a.b.C``.
    """
    imported = _ZOO_IMPORT.fullmatch(name)
    if imported is not None:
        return f"{imported[2]}.{imported[3]}"
    head, dot, rest = name.partition(".")
    return f"{_ZOO_NAMES.get(head, head)}{dot}{rest}"


def import_name(name: str) -> Any:
    """Return what an import path names.

    Args:
        name: ``package.module.Class``, also with the Zoo's short names.
    """
    path = full_name(name)
    if not is_dotted(path):
        raise ConfigError(f"{name!r} is no import path: expected 'package.module.Name'.")
    first, *others = path.split(".")
    found = _imported(first, name)
    for part in others:
        if isinstance(found, ModuleType) and not hasattr(found, part):
            _imported(f"{found.__name__}.{part}", name, inside=found)
        found = _attribute(found, part, name)
    return found


def _attribute(owner: Any, part: str, name: str) -> Any:
    try:
        return getattr(owner, part)
    except AttributeError:
        raise ConfigError(
            f"{name!r} cannot be imported: {getattr(owner, '__name__', name)} has no {part!r}."
            f"{near_names(part, dir(owner))}"
        ) from None


def _imported(path: str, name: str, inside: ModuleType | None = None) -> ModuleType | None:
    """Return a module; ``None`` if there is no such module in the given one."""
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError as error:
        if inside is not None and error.name == path:
            return None
        raise ConfigError(
            f"{name!r} cannot be imported: {error}. Expected 'package.module.Name' of an installed "
            "package."
        ) from error
    except Exception as error:  # a module may fail in any way while it is imported
        raise ConfigError(f"{name!r} cannot be imported: {path} raises {error!r}.") from error


def import_class(name: str, *bases: type) -> type:
    """Return the class that an import path names, if it is below one of some classes.

    Whatever may be called later goes through here, so that no configuration can name a function
    such as ``os.system`` and have it called. The module is imported all the same.
    """
    found = import_name(name)
    if not isinstance(found, type) or not issubclass(found, bases):
        raise ConfigError(
            f"{name!r} is no subclass of {' or '.join(base.__name__ for base in bases)}: expected "
            "the import path of one."
        )
    return found


def registered_id(env_id: str, module: str | None = None) -> tuple[str | None, str]:
    """Return the module to import for an environment, if any, and its id.

    Args:
        env_id: A registered id, or ``module:Id``; the module is imported.
        module: The module, if the id does not name one.
    """
    named, _, name = env_id.rpartition(":")
    module = named or module
    if module:
        _import_registering(module, name)
    if name not in gym.registry:
        raise ConfigError(
            f"Unknown environment {name!r}.{near_names(name, gym.registry)} Expected a registered "
            "id, or 'module:Id' to import the module that registers it."
        )
    return module, name


def _import_registering(module: str, name: str) -> None:
    """Import the module that registers an environment, and no other, if it can be told."""
    registered, is_new = gym.registry.get(name), module not in sys.modules
    try:
        importlib.import_module(module)
    except Exception as error:  # a module may fail in any way while it is imported
        raise ConfigError(
            f"Module {module!r} of environment {name!r} cannot be imported: {error}."
        ) from error
    if is_new and registered is not None and gym.registry.get(name) is registered:
        raise ConfigError(
            f"Module {module!r} does not register environment {name!r}, which is there without it: "
            "expected no module, or the one that registers it."
        )


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """Return the stock class of an algorithm."""
    if name in PLANNERS:
        raise ConfigError(
            f"Algorithm {name!r} is not trained, it plays at once: expected 'sb3-piano plan', "
            f"which makes a run of it, or one of {', '.join(ALGORITHMS)}."
        )
    if name not in _ALGORITHMS:
        raise ConfigError(
            f"Unknown algorithm {name!r}.{near_names(str(name), ALGORITHMS)} Expected one of "
            f"{', '.join(ALGORITHMS)}."
        )
    module, class_name = _ALGORITHMS[name]
    try:
        found: type[BaseAlgorithm] = getattr(importlib.import_module(module), class_name)
    except ModuleNotFoundError as error:
        package = module.replace("_", "-")
        raise ImportError(f"{class_name} needs {package}: pip install {package}") from error
    return found


def planner_class(name: str) -> type[PianoPolicy]:
    """Return the class of what plays without training, one of :data:`PLANNERS`."""
    module, class_name = _PLANNERS[name]
    found: type[PianoPolicy] = getattr(importlib.import_module(module), class_name)
    return found
