"""Load YAML files of hyperparameters in RL Zoo's format."""

from __future__ import annotations

import dataclasses
import difflib
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from types import NoneType
from typing import Any

from sb3_piano.exceptions import ConfigError, naming, near_names
from sb3_piano.hyperparams import NAMED, PRESETS
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.settings import refuse_unknown
from sb3_piano.training.configuration.config import RunConfig
from sb3_piano.training.configuration.names import algorithm_class, registered_id
from sb3_piano.training.configuration.values import coerce_mapping

_DEFAULT_ENTRY = "default"
# No hyperparameters: they select the file and the entry.
_NOT_IN_ENTRY = ("algo", "env_id", "env_module", "algorithm_kwargs")


def load_config(
    algo: str, env_id: str, path: str | os.PathLike[str] | None = None, **overrides: Any
) -> RunConfig:
    """Load the hyperparameters of an algorithm for an environment.

    The file has one entry per environment id; ``default`` is for all others. The keys are RL Zoo's:
    settings of the run (fields of :class:`RunConfig`), and all others are arguments of the
    algorithm's constructor. ``algorithms`` may hold settings for one algorithm each, which replace
    the entry's or are added to them (``env_kwargs``, ``policy_kwargs``).

    Args:
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``.
        path: The YAML file, or the name of a set of presets, one of
            :data:`~sb3_piano.hyperparams.NAMED`, such as "fast"; by default the algorithm's preset
            of published settings.
        **overrides: Keys that replace the entry's. ``env_kwargs`` are added to the entry's.

    Raises:
        ConfigError: If the file cannot be read, has no entry for the environment, or a setting is
            not valid; the message names file, entry and key.
    """
    return _loaded(algo, env_id, path, overrides)[1]


def overlaid(path: str | os.PathLike[str], env_id: str, over: Mapping[str, Any]) -> dict[str, Any]:
    """Load a file's hyperparameters for an environment, with others in place of its keys.

    Raises:
        ConfigError: If the file cannot be read, or has no entry for the environment.
    """
    if path in NAMED:
        raise ConfigError(
            f"The preset {str(path)!r} is for a training from nothing, and a correction has its "
            "own preset: expected a YAML file with changes, or none."
        )
    entry_name, entry = _entry_of(Path(path), registered_id(env_id)[1])
    with naming(f"'{path}', entry {entry_name!r}"):
        entry = merged(entry, over)
    return entry


def load_entry(
    algo: str, env_id: str, path: str | os.PathLike[str] | None = None, **overrides: Any
) -> dict[str, Any]:
    """Load the raw entry that :func:`load_config` reads, with the overrides.

    Arguments and errors are as for :func:`load_config`; :func:`entry_config` converts the entry.
    """
    return _loaded(algo, env_id, path, overrides)[0]


def entry_config(algo: str, env_id: str, entry: Mapping[str, Any]) -> RunConfig:
    """Validate an entry and return it as settings."""
    names = {f.name for f in dataclasses.fields(RunConfig)}.difference(_NOT_IN_ENTRY)
    fields, rest = parted(entry, names)
    if "n_timesteps" not in fields:  # the one setting without a default
        near = difflib.get_close_matches("n_timesteps", map(str, rest), 1)
        slip = f" Did you mean it by {near[0]!r}?" if near else ""
        raise ConfigError(f"n_timesteps is missing: it has no default.{slip}")
    return RunConfig(algo=algo, env_id=env_id, algorithm_kwargs=rest, **fields)


def _loaded(
    algo: str, env_id: str, path: str | os.PathLike[str] | None, overrides: Mapping[str, Any]
) -> tuple[dict[str, Any], RunConfig]:
    if not isinstance(path, (str, os.PathLike, NoneType)):
        raise ConfigError(f"config is {path!r}: expected a YAML file, or the name of a preset.")
    algorithm_class(algo)
    _, name = registered_id(env_id)
    file = _preset(algo, path) if path is None or path in NAMED else _own_file(path)
    entry_name, found = _entry_of(file, name)
    given = f" with {', '.join(overrides)} replaced" if overrides else ""
    with naming(f"'{file}', entry {entry_name!r}{given}"):
        entry = merged(_of_algorithm(found, algo), overrides)
        config = entry_config(algo, env_id, entry)
    return entry, config


def _own_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file; raise ConfigError for an unknown name."""
    file = Path(path)
    if not file.suffix and not os.path.exists(file):
        raise ConfigError(
            f"There is no file '{file}', and no preset of that name: expected a YAML file, or one "
            f"of {', '.join(NAMED)}.{near_names(str(file), NAMED)}"
        )
    return file


def _preset(algo: str, name: str | os.PathLike[str] | None) -> Path:
    """Return the file of a preset."""
    known = PRESETS if name is None else NAMED[str(name)]
    if algo not in known:
        kind = "preset" if name is None else f"preset {name!r}"
        raise ConfigError(
            f"No {kind} comes with this package for {algo!r}: expected one of "
            f"{', '.join(known)}, or a YAML file of your own (--config)."
        )
    return known[algo]


def _entry_of(file: Path, name: str) -> tuple[str, Any]:
    """Return the name and content of a file's entry for an environment."""
    entries = read_yaml_mapping(file)
    entry_name = name if name in entries else _DEFAULT_ENTRY
    if entry_name not in entries:
        raise ConfigError(
            f"'{file}' has no entry for {name!r}.{near_names(name, map(str, entries))} Expected "
            f"that id or {_DEFAULT_ENTRY!r} as a key at the top level."
        )
    return entry_name, entries[entry_name]


def _of_algorithm(entry: Any, algo: str) -> Any:
    """Return an entry with its settings for one of several algorithms, if it has such."""
    if not isinstance(entry, Mapping) or "algorithms" not in entry:
        return entry
    own, shared = parted(entry, ["algorithms"])
    of_each = coerce_mapping(own["algorithms"], "algorithms")
    refuse_unknown([algo], of_each, "algorithm of this file")
    return merged(shared, of_each[algo], ("env_kwargs", "policy_kwargs"))


def merged(
    entry: Any, overrides: Mapping[str, Any], by_option: Collection[str] = ("env_kwargs",)
) -> dict[str, Any]:
    """Return an entry with overridden keys; ``env_kwargs`` are merged option by option.

    Raises:
        ConfigError: If the entry or its ``env_kwargs`` are no mapping.
    """
    if not isinstance(entry, Mapping):
        raise ConfigError(f"It holds {entry!r}: expected a mapping of hyperparameters.")
    both = {**entry, **overrides}
    for name in by_option:
        if name in entry and name in overrides:
            options = [coerce_mapping(e[name], name) for e in (entry, overrides)]
            both[name] = options[0] | options[1]
    return both


def parted(
    mapping: Mapping[str, Any], names: Collection[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the entries with some names, and all others."""
    own = {name: value for name, value in mapping.items() if name in names}
    return own, {name: value for name, value in mapping.items() if name not in names}
