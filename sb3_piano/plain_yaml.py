"""Read YAML settings: mappings, lists, text and numbers of bounded size."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import yaml

from sb3_piano.exceptions import ConfigError, one_line
from sb3_piano.files import load_yaml, read_file

_MOST_BYTES, _DEEPEST, _MOST_VALUES = 2**21, 50, 10**5
"""Most bytes, levels and values of a YAML file."""


def read_yaml_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping."""
    try:
        content = parse_yaml(read_file(path, _MOST_BYTES).decode())
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(f"'{path}' cannot be read: {reason}. Expected a YAML file.") from error
    except ConfigError as error:
        raise ConfigError(f"'{path}' {error}") from error
    if not isinstance(content, dict):
        raise ConfigError(
            f"'{path}' holds {type(content).__name__} at the top level: expected a mapping."
        )
    return content


def parse_yaml(text: str) -> Any:
    """Parse YAML text."""
    try:
        _check_depth(text)
        content = load_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"is not valid YAML: {one_line(error)}.") from error
    _check_plain(content)
    return content


def _check_depth(text: str) -> None:
    """Raise ValueError for nesting so deep that libyaml would crash the process."""
    depth = 0
    for event in yaml.parse(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
        started = isinstance(event, yaml.CollectionStartEvent)
        depth += started - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise ValueError(f"it is nested deeper than {_DEEPEST} levels")


def _check_plain(content: Any) -> None:
    """Raise ConfigError for keys that are no text, and for endless nesting or repetition."""
    level, count = [content], 0
    for _ in range(_DEEPEST):
        maps = [item for item in level if isinstance(item, dict)]
        for key in itertools.chain.from_iterable(maps):
            if not isinstance(key, str):
                raise ConfigError(f"has the key {key!r}: expected text.")
        parts = [m.values() for m in maps] + [i for i in level if isinstance(i, (list, tuple))]
        count += sum(map(len, parts))
        if count > _MOST_VALUES:
            break
        level = list(itertools.chain.from_iterable(parts))
        if not level:
            return
    raise ConfigError(
        f"is nested without end: expected up to {_DEEPEST} levels and {_MOST_VALUES} values."
    )
