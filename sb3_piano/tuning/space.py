"""Search spaces: a range or choices for each of several settings, and where these stand."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import inspect
import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import gymnasium as gym
from annotated_types import Ge
from optuna.distributions import BaseDistribution
from optuna.trial import BaseTrial

import sb3_piano.wrappers
from sb3_piano.envs import DEFAULT_REWARD_WEIGHTS, PianoEnvConfig
from sb3_piano.exceptions import ConfigError, SB3PianoError, near_names
from sb3_piano.registration import ENTRY_POINT
from sb3_piano.settings import NotNegative, Number, Positive, Share, Unit, checked, number_in
from sb3_piano.training import Plugin, RunConfig
from sb3_piano.training.configuration.names import algorithm_class, registered_id
from sb3_piano.training.configuration.plugins import parse_plugins
from sb3_piano.training.configuration.values import (
    coerce_mapping,
    linear_start,
    parameters_of,
)
from sb3_piano.training.configuration.yaml_files import entry_config, read_yaml_mapping
from sb3_piano.training.runs.builders import build_model, build_vec_env
from sb3_piano.tuning.parameters import Parameter, parse_parameter

MISSING = object()
"""Result of :func:`setting_at` for a setting that the entry does not have."""

_PATH = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*")
_WRAPPERS = "env_wrapper"

# What trials are compared over has to be the same for all of them.
_FIXED = {
    "algo": "a study has one algorithm",
    "env_id": "a study has one environment",
    "env_module": "a study has one environment",
    "n_timesteps": "all trials have the same steps",
    "seed": "each trial trains from all seeds of the study",
}


class Space(Mapping[str, Parameter]):
    """Parameters by the settings they are for; it never changes.

    The names of settings are paths in an entry of an RL Zoo file: ``learning_rate``,
    ``policy_kwargs.net_arch``, ``env_kwargs.reward_weights.fingering``. As
    ``env_wrapper.TemporalStretch.factor`` one names an argument of the wrapper with that class
    name; a wrapper of ``sb3_piano.wrappers`` that the entry lacks is put around the others.

    Args:
        parameters: Optuna's distributions, or parameters in their form in YAML.

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
        return self._parameters[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parameters)

    def __len__(self) -> int:
        return len(self._parameters)

    @property
    def distributions(self) -> dict[str, BaseDistribution]:
        """Optuna's distributions by their names in the store."""
        return {p.stored_name(name): p.distribution for name, p in self.items()}

    def suggest(self, trial: BaseTrial) -> dict[str, Any]:
        """Return the settings of a trial by name."""
        return {name: parameter.suggest(trial, name) for name, parameter in self.items()}

    def settings(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings for the ``params`` of a trial, as far as it has them."""
        stored = ((name, p, p.stored_name(name)) for name, p in self.items())
        return {name: p.value(params[key]) for name, p, key in stored if key in params}

    def params_of(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Return the params with which a trial has the settings of an entry.

        Settings that the entry lacks, or whose values are not searched, are left out.
        """
        values = ((name, p, setting_at(entry, name)) for name, p in self.items())
        stored = {p.stored_name(n): p.stored(v) for n, p, v in values if v is not MISSING}
        return {name: value for name, value in stored.items() if value is not None}

    def to_mapping(self) -> dict[str, Any]:
        """Return the space in YAML's and JSON's types, of which it can be made again."""
        return {name: dict(parameter.form) for name, parameter in self.items()}


def _unsuitable(name: Any) -> str | None:
    """Return why a name is none that can be searched."""
    if not isinstance(name, str) or _PATH.fullmatch(name) is None:
        return "is no name of a setting: expected a path such as 'policy_kwargs.net_arch'"
    head, *rest = name.split(".")
    if head in _FIXED:
        return f"cannot be searched: {_FIXED[head]}"
    if head in ("callback", "vec_env_wrapper") and rest:
        return f"cannot be searched: expected {head!r} as a whole, a choice of lists"
    if head == _WRAPPERS and len(rest) == 1:
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
    if not path.suffix and not os.path.exists(path):
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

# Arguments of SB3's algorithms that these take without a look, and then learn nothing.
_NEEDS: Mapping[str, Any] = {
    **dict.fromkeys(("gamma", "tau", "gae_lambda"), Share),
    **dict.fromkeys(("learning_rate", "clip_range", "max_grad_norm"), Positive),
    **dict.fromkeys(
        ("batch_size", "buffer_size", "n_steps", "n_epochs", "policy_delay", "train_freq"),
        Annotated[Number, Ge(1)],
    ),
    "gradient_steps": Annotated[Number, Ge(1), Unit(", or -1 for as many as steps")],
    **dict.fromkeys(("learning_starts", "target_policy_noise", "target_noise_clip"), NotNegative),
}

# For models that are built only to see whether they can be.
_CHEAP = {"device": "cpu", "verbose": 0, "buffer_size": 100}


def check_space(space: Space, algo: str, env_id: str, entry: Mapping[str, Any]) -> None:
    """Build environment and model at both ends of all ranges, and with every choice.

    All parameters are at an end together; only where that fails are they tried one by one.

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
        by_itself = _objection(algo, env_id, entry, {})
        if by_itself is not None:  # such as a piece that is not there
            raise ConfigError(by_itself)
        for name, value in together.items():
            own_reason = _objection(algo, env_id, entry, {name: value})
            if own_reason is not None:
                raise ConfigError(f"Search space: {name!r} = {value!r}: {own_reason}")
        raise ConfigError(f"Search space: {together}: {reason}")


def _objection(
    algo: str, env_id: str, entry: Mapping[str, Any], settings: Mapping[str, Any]
) -> str | None:
    """Return why a run with these settings is impossible; ``None`` if it is not."""
    try:
        for name, value in settings.items():
            start = linear_start(value)
            number = number_in(value if start is None else start)
            is_all = (name, number) == ("gradient_steps", -1)
            if name in _NEEDS and isinstance(number, int | float) and not is_all:
                checked(name, number, _NEEDS[name])
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


# Settings in an RL Zoo entry by their paths.


def setting_at(entry: Mapping[str, Any], name: str) -> Any:
    """Return the value of a setting, or :data:`MISSING`."""
    head, *keys = name.split(".")
    value = entry.get(head, MISSING)
    if head == _WRAPPERS and keys:
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
            if head == _WRAPPERS and keys:
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


def _with_argument(wrappers: list[Plugin], keys: Sequence[str], value: Any) -> list[Any]:
    """Return wrappers with an argument of the one with the class name that comes first in a path.

    One of ``sb3_piano.wrappers`` that is missing is put around the others.
    """
    (name, *rest), names = keys, [_class_name(wrapper) for wrapper in wrappers]
    if names.count(name) > 1:
        raise ConfigError(f"{_WRAPPERS} has {name} {names.count(name)} times: expected it once.")
    if name not in names:
        own = sb3_piano.wrappers.__all__
        if name not in own:
            raise ConfigError(
                f"{_WRAPPERS} has no {name!r}.{near_names(name, [*names, *own])} Expected a class "
                "that it has, or one of sb3_piano.wrappers."
            )
        wrappers = [*wrappers, Plugin(path=f"{sb3_piano.wrappers.__name__}.{name}")]
    index = [*names, name].index(name)
    kwargs = _with_value(wrappers[index].kwargs, rest, value, f"{_WRAPPERS}.{name}")
    wrappers[index] = Plugin(path=wrappers[index].path, kwargs=kwargs)
    return [{plugin.path: dict(plugin.kwargs)} for plugin in wrappers]


def _wrappers(entry: Mapping[str, Any]) -> list[Plugin]:
    return list(parse_plugins(entry.get(_WRAPPERS), _WRAPPERS, gym.Wrapper))


def _class_name(wrapper: Plugin) -> str:
    return wrapper.path.rpartition(".")[2]
