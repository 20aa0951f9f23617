"""Classes and functions by their import path, as text in configuration files."""

from __future__ import annotations

import importlib
import re
from typing import Any

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
    parts = path.split(".")
    found, depth = _deepest_module(name, parts)
    for part in parts[depth:]:
        try:
            found = getattr(found, part)
        except AttributeError:
            owner = getattr(found, "__name__", name)
            raise ConfigError(
                f"{name!r} cannot be imported: {owner} has no {part!r}."
                f"{near_names(part, dir(found))}"
            ) from None
    return found


def import_class(name: str, *bases: type) -> type:
    """Return the class that an import path names, if it is below one of some classes.

    Whatever may be called later goes through here, so that no configuration can name a function
    such as ``os.system`` and have it called. The module is imported all the same.

    Raises:
        ConfigError: If there is no such thing, or it is no such class.
    """
    return checked_class(import_name(name), name, *bases)


def checked_class(found: Any, name: str, *bases: type) -> type:
    """Return what a name was found to stand for, if it is a class below one of some classes.

    Raises:
        ConfigError: If it is not.
    """
    if not isinstance(found, type) or not issubclass(found, bases):
        expected = " or ".join(base.__name__ for base in bases)
        raise ConfigError(
            f"{name!r} is no subclass of {expected}: expected the import path of one."
        )
    return found


def _deepest_module(name: str, parts: list[str]) -> tuple[Any, int]:
    """Import as many leading parts as are modules; return the module and their number."""
    module = None
    for depth in range(1, len(parts)):
        path = ".".join(parts[:depth])
        try:
            module = importlib.import_module(path)
        except ModuleNotFoundError as error:
            if error.name == path and module is not None:
                return module, depth - 1
            raise ConfigError(
                f"{name!r} cannot be imported: {error}. Expected 'package.module.Name' of an "
                "installed package."
            ) from error
        except Exception as error:  # a module may fail in any way while it is imported
            raise ConfigError(f"{name!r} cannot be imported: {path} raises {error!r}.") from error
    return module, len(parts) - 1
