"""Wrappers and callbacks named in a configuration, written as RL Zoo writes them."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.import_names import full_name, import_class, import_name
from sb3_piano.training.plain import plain_mapping

_FORMS = "'package.module.Name', {package.module.Name: {argument: value}} or a list of these"


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """A class by its import path, with the arguments to call it with."""

    path: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", full_name(self.path))
        object.__setattr__(self, "kwargs", plain_mapping(self.kwargs, self.path))

    def __call__(self, *args: Any) -> Any:
        """Make one of the class, which :func:`parse_plugins` has checked.

        Raises:
            ConfigError: If it does not take these arguments.
        """
        function = import_name(self.path)
        try:
            inspect.signature(function).bind(*args, **self.kwargs)
        except TypeError as error:
            raise ConfigError(
                f"{self.path} cannot be called with {dict(self.kwargs)}: {error}."
            ) from error
        except ValueError:
            pass  # a builtin that does not tell its parameters
        return function(*args, **self.kwargs)


def parse_plugins(value: Any, key: str, base: type) -> tuple[Plugin, ...]:
    """Return the plugins of one key of a configuration, in their order.

    Args:
        value: ``None``, an import path, a mapping from one path to its arguments, or a list.
        key: The key, for error messages.
        base: What each of the classes must be below.

    Raises:
        ConfigError: If the value has another form, or a path leads nowhere or to something else.
    """
    if value is None:
        return ()
    entries = value if isinstance(value, (list, tuple)) else [value]
    try:
        plugins = tuple(_plugin(entry, key) for entry in entries)
        for plugin in plugins:
            import_class(plugin.path, base)
        return plugins
    except ConfigError as error:
        raise ConfigError(f"{key}: {error}") from error


def plugins_to_plain(plugins: tuple[Plugin, ...]) -> list[dict[str, Any]]:
    """Return plugins in the form that :func:`parse_plugins` reads."""
    return [{plugin.path: dict(plugin.kwargs)} for plugin in plugins]


def _plugin(entry: Any, key: str) -> Plugin:
    if isinstance(entry, Plugin):
        return entry
    if isinstance(entry, str):
        return Plugin(path=entry)
    if isinstance(entry, Mapping) and len(entry) == 1:
        path, kwargs = next(iter(entry.items()))
        if isinstance(path, str) and (kwargs is None or isinstance(kwargs, Mapping)):
            return Plugin(path=path, kwargs=kwargs or {})
    raise ConfigError(f"{entry!r} is no entry for {key}: expected {_FORMS}.")
