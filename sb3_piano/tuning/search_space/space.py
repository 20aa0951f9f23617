"""What a study searches: a range or choices for each of several settings."""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from optuna.distributions import BaseDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training.configuration.yaml_files import read_yaml_mapping
from sb3_piano.tuning.search_space.check import check_space
from sb3_piano.tuning.search_space.entry_paths import (
    MISSING,
    WRAPPERS,
    outermost_first,
    setting_at,
    with_setting,
)
from sb3_piano.tuning.search_space.parsing import Parameter, parse_parameter

_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")

# What trials are compared over has to be the same for all of them.
_FIXED = {
    "algo": "a study has one algorithm",
    "env_id": "a study has one environment",
    "env_module": "a study has one environment",
    "n_timesteps": "all trials have the same steps",
    "seed": "each trial trains from all seeds of the study",
}
_PLUGINS_AS_A_WHOLE = ("callback", "vec_env_wrapper")


class Space(Mapping[str, Parameter]):
    """Parameters by the settings they are for; it never changes.

    The names of settings are paths in an entry of an RL Zoo file: ``learning_rate``,
    ``policy_kwargs.net_arch``, ``env_kwargs.reward_weights.fingering``. As
    ``env_wrapper.TemporalStretch.factor`` one names an argument of the wrapper with that class
    name; a wrapper of ``sb3_piano.wrappers`` that the entry lacks is put around the others.

    Args:
        parameters: Parameters, also in their form in YAML.

    Raises:
        ConfigError: If there is none, or a name or a parameter is not valid.
    """

    def __init__(self, parameters: Mapping[str, Any]):
        if not isinstance(parameters, Mapping) or not parameters:
            raise ConfigError(
                f"Search space: {parameters!r} has no parameter: expected a mapping from settings "
                "to parameters, such as {tau: {float: [0.001, 0.1], log: true}}."
            )
        for name in parameters:
            _check_name(name)
        self._parameters = {name: parse_parameter(name, p) for name, p in parameters.items()}

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter for a setting."""
        return self._parameters[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    def __repr__(self) -> str:
        return f"Space({self._parameters!r})"

    @property
    def distributions(self) -> dict[str, BaseDistribution]:
        """Optuna's distributions by their names in the store."""
        return {p.stored_name(name): p.distribution for name, p in self.items()}

    def suggest(self, trial: BaseTrial) -> dict[str, Any]:
        """Return the settings of a trial by name."""
        return {name: parameter.suggest(trial, name) for name, parameter in self.items()}

    def settings(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings for the ``params`` of a trial, as far as it has them."""
        return {
            name: parameter.value(params[parameter.stored_name(name)])
            for name, parameter in self.items()
            if parameter.stored_name(name) in params
        }

    def apply(self, entry: Mapping[str, Any], settings: Mapping[str, Any]) -> dict[str, Any]:
        """Return a copy of an entry with these settings.

        Raises:
            ConfigError: If the entry has no place for one.
        """
        applied = copy.deepcopy(dict(entry))
        for name in outermost_first(settings):
            try:
                applied = with_setting(applied, name, settings[name])
            except ConfigError as error:
                raise ConfigError(f"Search space: {name!r}: {error}") from error
        return applied

    def params_of(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Return the params with which a trial has the settings of an entry.

        Settings that the entry lacks, or whose values are not searched, are left out.
        """
        params = {}
        for name, parameter in self.items():
            value = setting_at(entry, name)
            stored = None if value is MISSING else parameter.stored(value)
            if stored is not None:
                params[parameter.stored_name(name)] = stored
        return params

    def to_mapping(self) -> dict[str, Any]:
        """Return the space in YAML's and JSON's types; :meth:`from_mapping` gives it back."""
        return {name: parameter.to_plain() for name, parameter in self.items()}

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any]) -> Space:
        """Return the space that a YAML file describes.

        Raises:
            ConfigError: If there is no parameter, or a name or a parameter is not valid.
        """
        return cls(mapping)

    def check(self, algo: str, env_id: str, entry: Mapping[str, Any]) -> None:
        """Try every setting at its extremes where it enters, without training anything.

        Args:
            algo: Name of the algorithm.
            env_id: Id of the environment, or ``module:Id``.
            entry: The settings from which trials depart.

        Raises:
            ConfigError: If a setting is unknown, or one of its values impossible.
        """
        check_space(self, algo, env_id, entry)


def load_space(sources: Sequence[str | os.PathLike[str]], algo: str) -> Space:
    """Return the parameters of several spaces together.

    Args:
        sources: Names of :data:`~sb3_piano.tuning.SPACES` or YAML files, each with parameters by
            setting; a later one replaces parameters of those before. By default the space that
            comes with this package for the algorithm.
        algo: Name of the algorithm.

    Raises:
        ConfigError: If there is no such space or file, or one is not valid.
    """
    from sb3_piano.tuning.search_space.built_in import SPACES  # which is made of spaces

    if not sources and algo not in SPACES:
        raise ConfigError(
            f"No search space comes with this package for {algo!r}: expected one of "
            f"{', '.join(SPACES)}, or a YAML file of your own (--space)."
        )
    parameters: dict[str, Parameter] = {}
    for source in sources or (algo,):
        known = SPACES.get(str(source))
        parameters.update(_read(Path(source), SPACES) if known is None else known)
    return Space(parameters)


def _read(path: Path, known: Mapping[str, Space]) -> Space:
    if not path.suffix and not path.exists():
        raise ConfigError(
            f"Unknown search space '{path}'.{near_names(str(path), known)} Expected one of "
            f"{', '.join(known)}, or a YAML file."
        )
    content = read_yaml_mapping(path)
    try:
        return Space.from_mapping(content)
    except ConfigError as error:
        raise ConfigError(f"'{path}': {error}") from error


def _check_name(name: Any) -> None:
    reason = _unsuitable(name)
    if reason is not None:
        raise ConfigError(f"Search space: {name!r} {reason}.")


def _unsuitable(name: Any) -> str | None:
    """Return why a name is none that can be searched."""
    if not isinstance(name, str) or _PATH.fullmatch(name) is None:
        return "is no name of a setting: expected a path such as 'policy_kwargs.net_arch'"
    head, *rest = name.split(".")
    if head in _FIXED:
        return f"cannot be searched: {_FIXED[head]}"
    if head in _PLUGINS_AS_A_WHOLE and rest:
        return f"cannot be searched: expected {head!r} as a whole, a choice of lists"
    if head == WRAPPERS and len(rest) == 1:
        return f"names no argument: expected '{name}.<argument>'"
    return None
