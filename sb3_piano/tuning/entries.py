"""Settings in an RL Zoo entry by their paths, such as ``policy_kwargs.net_arch``."""

from __future__ import annotations

import copy
import dataclasses
import inspect
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium as gym

import sb3_piano.wrappers
from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnvConfig
from sb3_piano.envs.registration import ENTRY_POINT
from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training import Plugin, RunConfig
from sb3_piano.training.configuration.config import parse_plugins
from sb3_piano.training.configuration.names import algorithm_class, registered_id
from sb3_piano.training.configuration.values import coerce_mapping, parameters_of

MISSING = object()
"""Result of :func:`setting_at` for a setting that the entry does not have."""

WRAPPERS = "env_wrapper"
"""The key whose paths go on with the class name of a wrapper."""


def setting_at(entry: Mapping[str, Any], name: str) -> Any:
    """Return the value of a setting, or :data:`MISSING`."""
    head, *keys = name.split(".")
    value = entry.get(head, MISSING)
    if head == WRAPPERS and keys:
        found = [p for p in _wrappers(entry) if _class_name(p) == keys[0]]
        value, keys = (found[0].kwargs if found else MISSING), keys[1:]
    for key in keys:
        try:
            value = coerce_mapping(value, head).get(key, MISSING)
        except ConfigError:
            return MISSING  # nothing that could hold it
    return value


def with_settings(entry: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of an entry with these settings; what is missing on the way to them is made.

    What holds others comes before them, as they may change parts of it. Where a path leads into
    text that RL Zoo evaluates, a mapping takes its place.

    Raises:
        ConfigError: If the entry has no place for one.
    """
    changed = copy.deepcopy(dict(entry))
    for name in sorted(settings, key=lambda name: name.count(".")):
        head, *keys = name.split(".")
        value = copy.deepcopy(settings[name])
        try:
            if head == WRAPPERS and keys:
                changed[head] = _with_argument(_wrappers(changed), keys, value)
            else:
                changed[head] = _with_value(changed.get(head), keys, value, head)
        except ConfigError as error:
            raise ConfigError(f"Search space: {name!r}: {error}") from error
    return changed


def with_defaults(algo: str, env_id: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of an entry in which the defaults are written out that trials may search.

    They are those of the algorithm's constructor and, if it is a piano, of the environment. It is
    not for training: some of them are nothing that YAML could hold.

    Args:
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``.
        entry: The settings, as in an RL Zoo YAML file.

    Raises:
        ConfigError: If there is no such algorithm or environment.
    """
    parameters = parameters_of(algorithm_class(algo)).values()
    defaults = {p.name: p.default for p in parameters if p.default is not inspect.Parameter.empty}
    full = {"policy": RunConfig.policy, **defaults, **copy.deepcopy(dict(entry))}
    if gym.spec(registered_id(env_id)[1]).entry_point != ENTRY_POINT:
        return full
    options = dataclasses.fields(PianoEnvConfig)
    env_defaults = {o.name: o.default for o in options if o.default is not dataclasses.MISSING}
    env_kwargs = {**env_defaults, **coerce_mapping(full.get("env_kwargs") or {}, "env_kwargs")}
    weights = coerce_mapping(env_kwargs.get("reward_weights") or {}, "reward_weights")
    env_kwargs["reward_weights"] = {**DEFAULT_REWARD_WEIGHTS, **weights}
    return {**full, "env_kwargs": env_kwargs}


def _with_value(tree: Any, keys: Sequence[str], value: Any, where: str) -> Any:
    if not keys:
        return value
    branches = coerce_mapping({} if tree is None else tree, where)
    key, *rest = keys
    return {**branches, key: _with_value(branches.get(key), rest, value, f"{where}.{key}")}


def _wrappers(entry: Mapping[str, Any]) -> list[Plugin]:
    return list(parse_plugins(entry.get(WRAPPERS), WRAPPERS, gym.Wrapper))


def _with_argument(wrappers: list[Plugin], keys: Sequence[str], value: Any) -> list[Any]:
    """Return wrappers with an argument of the one with the class name that comes first in a path.

    One of ``sb3_piano.wrappers`` that is missing is put around the others.
    """
    name, *rest = keys
    found = [index for index, plugin in enumerate(wrappers) if _class_name(plugin) == name]
    if len(found) > 1:
        raise ConfigError(f"{WRAPPERS} has {name} {len(found)} times: expected it once.")
    if not found:
        _check_own_wrapper(name, map(_class_name, wrappers))
        wrappers = [*wrappers, Plugin(path=f"{sb3_piano.wrappers.__name__}.{name}")]
    index = found[0] if found else -1
    former = wrappers[index]
    kwargs = _with_value(former.kwargs, rest, value, f"{WRAPPERS}.{name}")
    wrappers[index] = Plugin(path=former.path, kwargs=kwargs)
    return [{plugin.path: dict(plugin.kwargs)} for plugin in wrappers]


def _class_name(wrapper: Plugin) -> str:
    return wrapper.path.rpartition(".")[2]


def _check_own_wrapper(name: str, there: Iterable[str]) -> None:
    own = sb3_piano.wrappers.__all__
    if name not in own:
        raise ConfigError(
            f"{WRAPPERS} has no {name!r}.{near_names(name, [*there, *own])} Expected a class that "
            "it has, or one of sb3_piano.wrappers."
        )
