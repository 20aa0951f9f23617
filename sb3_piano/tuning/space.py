"""Search spaces: a range or choices for each of several settings."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from optuna.distributions import BaseDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError, SB3PianoError, near_names
from sb3_piano.training import entry_config
from sb3_piano.training.configuration.values import coerce, linear_start, parameters_of
from sb3_piano.training.configuration.yaml_files import read_yaml_mapping
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.tuning.entries import MISSING, WRAPPERS, setting_at, with_settings
from sb3_piano.tuning.parameters import Parameter, parse_parameter

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
            reason = _unsuitable(name)
            if reason is not None:
                raise ConfigError(f"Search space: {name!r} {reason}.")
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
        """Return the space in YAML's and JSON's types, of which it can be made again."""
        return {name: parameter.to_plain() for name, parameter in self.items()}


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


# Spaces by name and from files.


def _own_spaces() -> dict[str, Space]:
    groups = read_yaml_mapping(Path(__file__).with_name("spaces.yml"))
    return {name: Space(groups[name]) for name in groups if not name.startswith("_")}


SPACES: Mapping[str, Space] = MappingProxyType(_own_spaces())
"""By the name of their algorithm; "env" and "reward" are for any."""


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
    if not sources and algo not in SPACES:
        raise ConfigError(
            f"No search space comes with this package for {algo!r}: expected one of "
            f"{', '.join(SPACES)}, or a YAML file of your own (--space)."
        )
    parameters: dict[str, Parameter] = {}
    for source in sources or (algo,):
        parameters.update(SPACES.get(str(source)) or _read(Path(source)))
    return Space(parameters)


def _read(path: Path) -> Space:
    if not path.suffix and not path.exists():
        raise ConfigError(
            f"Unknown search space '{path}'.{near_names(str(path), SPACES)} Expected one of "
            f"{', '.join(SPACES)}, or a YAML file."
        )
    content = read_yaml_mapping(path)
    try:
        return Space(content)
    except ConfigError as error:
        raise ConfigError(f"'{path}': {error}") from error


# Spaces, tried out before anything is trained.

_Need = tuple[Callable[[float], bool], str]
_SHARE: _Need = (lambda x: 0 <= x <= 1, "0 to 1")
_POSITIVE: _Need = (lambda x: x > 0, "more than 0")
_COUNT: _Need = (lambda x: x >= 1, "1 or more")
_NOT_NEGATIVE: _Need = (lambda x: x >= 0, "0 or more")

# Arguments of SB3's algorithms that these take without a look, and then learn nothing.
_NEEDS: Mapping[str, _Need] = {
    **dict.fromkeys(("gamma", "tau", "gae_lambda"), _SHARE),
    **dict.fromkeys(("learning_rate", "clip_range", "max_grad_norm"), _POSITIVE),
    **dict.fromkeys(("batch_size", "buffer_size", "n_steps", "n_epochs"), _COUNT),
    **dict.fromkeys(("policy_delay", "train_freq"), _COUNT),
    "gradient_steps": (lambda x: x >= 1 or x == -1, "1 or more, or -1 for as many as steps"),
    **dict.fromkeys(("learning_starts", "target_policy_noise", "target_noise_clip"), _NOT_NEGATIVE),
}

# For models that are built only to see whether they can be.
_CHEAP = {"device": "cpu", "verbose": 0, "buffer_size": 100}


def check_space(space: Space, algo: str, env_id: str, entry: Mapping[str, Any]) -> None:
    """Build environment and model at both ends of all ranges, and with every choice.

    All parameters are at an end together; only where that fails are they tried one by one.

    Args:
        space: The space.
        algo: Name of the algorithm.
        env_id: Id of the environment, or ``module:Id``.
        entry: The settings from which trials depart.

    Raises:
        ConfigError: If a setting is unknown, or one of its values impossible.
    """
    entry_config(algo, env_id, entry)  # what is wrong by itself is not blamed on the space
    extremes = {name: parameter.extremes() for name, parameter in space.items()}
    for index in range(max(map(len, extremes.values()))):
        together = {name: ends[min(index, len(ends) - 1)] for name, ends in extremes.items()}
        reason = _objection(algo, env_id, entry, together)
        if reason is None:
            continue
        for name, value in together.items():
            own_reason = _objection(algo, env_id, entry, {name: value})
            if own_reason is not None:
                raise ConfigError(f"Search space: {name!r} = {value!r}: {own_reason}")
        raise ConfigError(f"Search space: {together}: {reason}")


def _objection(
    algo: str, env_id: str, entry: Mapping[str, Any], settings: Mapping[str, Any]
) -> str | None:
    """Return why a run with these settings is impossible; ``None`` if it is not."""
    for name, value in settings.items():
        if name in _NEEDS and not _meets(name, value):
            return f"{name} is {value!r}: expected {_NEEDS[name][1]}."
    try:
        config = entry_config(algo, env_id, with_settings(entry, settings))
        cheap = {k: v for k, v in _CHEAP.items() if k in parameters_of(config.algorithm)}
        arguments = {**config.algorithm_kwargs, **cheap}
        config = dataclasses.replace(config, n_envs=1, vec_env="dummy", algorithm_kwargs=arguments)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they come when the trial is trained
            with contextlib.closing(build_vec_env(config)) as venv:
                build_model(config, venv)
                venv.reset()
    except SB3PianoError as error:
        return str(error).removeprefix("Search space: ")
    except Exception as error:  # environments and algorithms may refuse values in any way
        return f"{type(error).__name__}: {error}"
    return None


def _meets(name: str, value: Any) -> bool:
    start = linear_start(value)
    try:
        return _NEEDS[name][0](coerce(value, float, name) if start is None else start)
    except ConfigError:
        return True  # no number, as [1, episode] for train_freq
