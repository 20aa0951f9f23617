"""Environment ids, with or without the module that registers them."""

from __future__ import annotations

import importlib

import gymnasium as gym

from sb3_piano.exceptions import ConfigError, near_names


def registered_id(env_id: str, module: str | None = None) -> tuple[str | None, str]:
    """Return the module to import for an environment, if any, and its id.

    Args:
        env_id: A registered id, or ``module:Id``; the module is imported.
        module: The module, if the id does not name one.

    Raises:
        ConfigError: If the module cannot be imported, or no such environment is registered then.
    """
    named, _, name = env_id.rpartition(":")
    module = named or module
    if module:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ConfigError(
                f"Module {module!r} of environment {name!r} cannot be imported: {error}."
            ) from error
    if name not in gym.registry:
        raise ConfigError(
            f"Unknown environment {name!r}.{near_names(name, gym.registry)} Expected a registered "
            "id, or 'module:Id' to import the module that registers it."
        )
    return module, name
