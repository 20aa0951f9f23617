"""An entry of hyperparameters in the form that stock RL Zoo trains with as well as we do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from sb3_piano.training import entry_config
from sb3_piano.tuning.search_space.zoo_source import Source, holds_class, source

# RL Zoo hands every key that it does not know to the algorithm, and these itself.
_NOT_IN_ZOO = ("seed", "vec_env", "device", "verbose")
_PLUGINS = ("env_wrapper", "vec_env_wrapper", "callback")
# RL Zoo evaluates text in these, which is the only way to write a class there.
_EVALUATED = ("policy_kwargs", "replay_buffer_class", "replay_buffer_kwargs")


class ZooEntry(NamedTuple):
    """An entry, and what had to stay out of it."""

    entry: dict[str, Any]
    """In YAML's types."""
    left_out: dict[str, Any]
    """Keys that stock RL Zoo refuses, with their values."""


def zoo_entry(algo: str, env_id: str, entry: Mapping[str, Any]) -> ZooEntry:
    """Return an entry so that stock RL Zoo understands each of its keys as we do.

    Numbers are written as numbers, ``env_kwargs`` as a mapping, and classes as text that RL Zoo
    evaluates. The order of the keys stays.

    Args:
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``.
        entry: The settings, as in an RL Zoo YAML file.

    Raises:
        ConfigError: If a setting is not valid.
    """
    mapping = entry_config(algo, env_id, entry).to_mapping()
    values = {**mapping, **mapping["algorithm_kwargs"]}
    written = ZooEntry({}, {})
    for name in dict.fromkeys((*entry, "policy")):  # which has no default there
        value = values[name]
        if name in _NOT_IN_ZOO:
            written.left_out[name] = value
        elif value is not None or not name.startswith("noise_"):  # no noise is no key there
            written.entry[name] = _as_zoo_writes(name, value)
    return written


def _as_zoo_writes(name: str, value: Any) -> Any:
    if name in _PLUGINS:
        return [plugin if kwargs else path for plugin in value for path, kwargs in plugin.items()]
    if name == "monitor_kwargs" and value:
        return str(source({key: _with_tuple(item) for key, item in value.items()}))
    return str(source(value)) if name in _EVALUATED and holds_class(value) else value


def _with_tuple(value: Any) -> Any:
    """Return a list as text that makes a tuple, which Monitor wants and YAML does not have."""
    return Source(repr(tuple(value))) if isinstance(value, list) else value
