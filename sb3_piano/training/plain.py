"""Values that YAML can hold and give back unchanged."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from sb3_piano.exceptions import ConfigError


def plain(value: Any, key: str) -> Any:
    """Return a copy of a value in YAML's types.

    Tuples become lists; paths of files, and classes by their import paths, become text.

    Raises:
        ConfigError: If it is, or holds, anything that YAML cannot give back.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, type):
        return f"{value.__module__}.{value.__qualname__}"
    if isinstance(value, Mapping):
        return plain_mapping(value, key)
    if isinstance(value, (list, tuple)):
        return [plain(item, f"{key}[{index}]") for index, item in enumerate(value)]
    raise ConfigError(
        f"{key} is a {type(value).__name__}, which a run's folder cannot hold: expected text, "
        "numbers, lists and mappings (for a score, the path of a file or the name of a piece)."
    )


def plain_mapping(value: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return a copy of a mapping by :func:`plain`; its keys must be text."""
    for name in value:
        if not isinstance(name, str):
            raise ConfigError(f"{key} has the key {name!r}: expected text.")
    return {name: plain(item, f"{key}.{name}") for name, item in value.items()}
