"""Plugins of a run: wrappers and callbacks by import path, with their arguments."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from sb3_piano.exceptions import ConfigError
from sb3_piano.imports import full_name, import_name
from sb3_piano.training.configuration.values import class_of, plain

_FORMS = "'package.module.Name', {package.module.Name: {argument: value}} or a list of these"


@dataclass(frozen=True, kw_only=True)
class Plugin:
    """A class by import path, with constructor arguments."""

    path: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "path", full_name(self.path))
        object.__setattr__(self, "kwargs", plain(self.kwargs, self.path))

    def is_a(self, kind: type) -> bool:
        """Return whether its class is ``kind`` or a subclass."""
        return issubclass(import_name(self.path), kind)

    def __call__(self, *args: Any) -> Any:
        """Make an instance.

        Raises:
            ConfigError: If the class does not accept these arguments.
        """
        function = import_name(self.path)
        try:
            inspect.signature(function).bind(*args, **self.kwargs)
        except TypeError as error:
            raise ConfigError(
                f"{self.path} cannot be called with {dict(self.kwargs)}: {error}."
            ) from error
        return function(*args, **self.kwargs)


def parse_plugins(value: Any, key: str, base: type) -> tuple[Plugin, ...]:
    """Parse plugins in RL Zoo's format; their classes must be subclasses of ``base``.

    ``value`` is ``None``, an import path, a mapping from one path to its arguments, or a list.
    """
    entries = value if isinstance(value, (list, tuple)) else [] if value is None else [value]
    plugins = tuple(_plugin(entry, key) for entry in entries)
    for plugin in plugins:
        class_of(plugin.path, (base,), key)
    return plugins


def with_arguments(plugins: Iterable[Plugin], kind: type, **arguments: Any) -> tuple[Plugin, ...]:
    """Return plugins; plugins of class ``kind`` get changed arguments."""
    return tuple(
        dataclasses.replace(p, kwargs={**p.kwargs, **arguments}) if p.is_a(kind) else p
        for p in plugins
    )


def _plugin(entry: Any, key: str) -> Plugin:
    if isinstance(entry, Plugin):
        return entry
    if isinstance(entry, str):
        return Plugin(path=entry)
    if isinstance(entry, Mapping) and len(entry) == 1:
        path, kwargs = next(iter(entry.items()))
        if isinstance(path, str) and (kwargs is None or isinstance(kwargs, Mapping)):
            return Plugin(path=path, kwargs=kwargs or {})
    raise ConfigError(f"{key}: {entry!r} is no entry for {key}: expected {_FORMS}.")
