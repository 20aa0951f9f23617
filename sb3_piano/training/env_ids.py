"""Environment ids, with or without the module that registers them."""

from __future__ import annotations

import importlib
import sys

import gymnasium as gym

from sb3_piano.exceptions import ConfigError, near_names


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
