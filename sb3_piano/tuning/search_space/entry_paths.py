"""Settings in an RL Zoo entry by their paths, such as ``policy_kwargs.net_arch``."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sb3_piano.wrappers
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training.configuration.values import coerce_mapping
from sb3_piano.tuning.search_space.zoo_source import Source, holds_class, opened, source

MISSING = object()
"""What :func:`setting_at` returns for a setting that the entry does not have."""

WRAPPERS = "env_wrapper"
# RL Zoo takes these as they are, and of those it evaluates text, the only form classes have there.
_AS_THEY_ARE = ("env_kwargs",)
_EVALUATED = ("policy_kwargs", "replay_buffer_kwargs", "replay_buffer_class")


def setting_at(entry: Mapping[str, Any], name: str) -> Any:
    """Return the value of a setting, or :data:`MISSING`."""
    head, *rest = name.split(".")
    value = entry.get(head, MISSING)
    if head == WRAPPERS and rest:
        value, rest = _arguments(entry.get(head), rest[0]), rest[1:]
    for key in rest:
        try:
            value = coerce_mapping(value, head).get(key, MISSING)
        except ConfigError:
            return MISSING  # nothing that could hold it
    return value


def outermost_first(names: Iterable[str]) -> list[str]:
    """Return names so that what holds others comes before them, as they may change parts of it."""
    return sorted(names, key=lambda name: name.count("."))


def with_setting(entry: Mapping[str, Any], name: str, value: Any) -> dict[str, Any]:
    """Return a copy of an entry in which a setting has a value; the rest is shared with it.

    What is on the way to it and missing is made. A mapping that is written as text, as RL Zoo
    evaluates it, remains text.

    Raises:
        ConfigError: If the path leads through something that cannot hold the setting.
    """
    head, *rest = name.split(".")
    changed = dict(entry)
    value = copy.deepcopy(value)
    if head == WRAPPERS and rest:
        changed[head] = _with_argument(changed.get(head), rest[0], rest[1:], value)
        return changed
    former = changed.get(head)
    if head in _AS_THEY_ARE and isinstance(former, str):
        former = coerce_mapping(former, head)
    changed[head] = _with_value(former, rest, value, head)
    if head in _EVALUATED and holds_class(changed[head]):
        changed[head] = str(source(changed[head]))
    return changed


def _with_value(tree: Any, keys: Sequence[str], value: Any, where: str) -> Any:
    if not keys:
        return value
    if tree is not None and not isinstance(tree, (str, Mapping)):
        raise ConfigError(f"{where} is {tree!r}: expected a mapping that can hold {keys[0]!r}.")
    branches = opened(tree, where) if isinstance(tree, str) else dict(tree or {})
    head, *rest = keys
    branches[head] = _with_value(branches.get(head), rest, value, f"{where}.{head}")
    if not isinstance(tree, str):
        return branches
    written = source(branches)
    return written if isinstance(tree, Source) else str(written)


def _arguments(wrappers: Any, name: str) -> Any:
    """Return the arguments of the wrapper with this class name."""
    for path, arguments in map(_parts, _listed(wrappers)):
        if _class_name(path) == name:
            return arguments
    return MISSING


def _with_argument(wrappers: Any, name: str, keys: Sequence[str], value: Any) -> list[Any]:
    """Return the wrappers of an entry with an argument of the one with this class name."""
    listed = _listed(wrappers)
    paths = [_parts(one)[0] for one in listed]
    found = [index for index, path in enumerate(paths) if _class_name(path) == name]
    if len(found) > 1:
        raise ConfigError(f"{WRAPPERS} has {name} {len(found)} times: expected it once.")
    if not found:
        listed.append(_own_wrapper(name, paths))
    index = found[0] if found else -1
    path, arguments = _parts(listed[index])
    listed[index] = {path: _with_value(arguments, keys, value, f"{WRAPPERS}.{name}")}
    return listed


def _listed(wrappers: Any) -> list[Any]:
    if wrappers is None:
        return []
    return list(wrappers) if isinstance(wrappers, (list, tuple)) else [wrappers]


def _parts(wrapper: Any) -> tuple[str, Any]:
    if isinstance(wrapper, Mapping) and len(wrapper) == 1:
        wrapper, arguments = next(iter(wrapper.items()))
    else:
        arguments = None
    if not isinstance(wrapper, str):
        raise ConfigError(
            f"{wrapper!r} is no entry for {WRAPPERS}: expected 'package.module.Name' or "
            "{package.module.Name: {argument: value}}."
        )
    return wrapper, arguments or {}


def _class_name(path: str) -> str:
    return path.rpartition(".")[2]


def _own_wrapper(name: str, paths: Sequence[str]) -> str:
    """Return the import path of a wrapper of ours."""
    own = sb3_piano.wrappers.__all__
    if name not in own:
        known = [*map(_class_name, paths), *own]
        raise ConfigError(
            f"{WRAPPERS} has no {name!r}.{near_names(name, known)} Expected a class that it has, "
            "or one of sb3_piano.wrappers."
        )
    return f"{sb3_piano.wrappers.__name__}.{name}"
