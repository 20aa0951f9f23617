"""Classes, functions and environments that configurations name by text."""

from __future__ import annotations

import importlib
import re
import sys
from types import ModuleType
from typing import Any

import gymnasium as gym

from sb3_piano.exceptions import ConfigError, near_names

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

    Raises:
        ConfigError: If there is no such thing, or importing its module fails.
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

    Raises:
        ConfigError: If there is no such thing, or it is no such class.
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

    Raises:
        ConfigError: If the module cannot be imported or does not register the environment, or no
            such environment is registered then.
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
