"""Search spaces: Optuna's distributions of a run's settings, in YAML's form."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

from optuna import distributions as optunas
from optuna.trial import BaseTrial, create_trial

from sb3_piano.envs import PianoEnvConfig
from sb3_piano.exceptions import ConfigError, SB3PianoError, naming, near_names, one_line
from sb3_piano.plain_yaml import read_yaml_mapping
from sb3_piano.settings import number_in
from sb3_piano.training import RunConfig
from sb3_piano.training.configuration.entries import setting_at, with_settings
from sb3_piano.training.configuration.names import algorithm_class
from sb3_piano.training.configuration.values import coerce, parameters_of, plain
from sb3_piano.training.configuration.yaml_files import entry_config
from sb3_piano.training.runs.builders import build_model, build_vec_env

_KINDS = ("float", "int", "discount", "choice")
_FORMS = (
    "{float: [1.0e-4, 1.0e-3], log: true}, {int: [1, 10], step: 3}, {choice: [64, 128]}, "
    "{choice: {small: [64], large: [256, 256]}} or {discount: [0.6, 0.97]}"
)
# Settings that trials must share to be comparable.
_SAME = ("algo", "env_id", "env_module", "n_timesteps", "seed")


@dataclass(frozen=True)
class Parameter:
    """An Optuna distribution, and the mapping from stored values to settings.

    The store holds a discount as its distance from 1, named "1 - gamma": ranges are even in the
    logarithm of the horizon, 10 steps for 0.9 and 100 for 0.99. It holds choices that are text,
    numbers or booleans as they are; other values as JSON text, such as "[256, 256]", or by their
    label in a mapping.
    """

    form: Mapping[str, Any]  # in YAML types, from which parse_parameter makes it again
    distribution: Any  # Optuna's, of the stored values
    choices: Mapping[Any, Any] | None = None  # values by the stored choice

    def stored_name(self, name: str) -> str:
        """Return the stored name of a setting's parameter."""
        return f"1 - {name}" if "discount" in self.form else name

    def value(self, stored: Any) -> Any:
        """Convert a stored value to the setting's value."""
        if self.choices is not None:
            return copy.deepcopy(self.choices[stored])
        if "discount" not in self.form:
            return stored
        low, high = self.form["discount"]
        return min(max(_distance_from_1(stored), low), high)  # rounding may exceed the range

    def stored(self, value: Any) -> Any:
        """Convert a value to its stored form; return ``None`` if it is out of the range."""
        try:
            number = number_in(value)
            number = _distance_from_1(number) if "discount" in self.form else number
            # Optuna checks it.
            create_trial(value=0, params={"": number}, distributions={"": self.distribution})
        except (ArithmeticError, TypeError, ValueError):
            return None
        return number

    def extremes(self) -> list[Any]:
        """Return both ends of a range, or all choices."""
        ends = self.choices or (self.distribution.low, self.distribution.high)
        return [self.value(end) for end in ends]

    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Draw the value of the setting ``name`` for a trial."""
        name, of = self.stored_name(name), self.distribution
        if self.choices is not None:
            return self.value(trial.suggest_categorical(name, of.choices))
        draw: Any = trial.suggest_int if "int" in self.form else trial.suggest_float
        return self.value(draw(name, of.low, of.high, log=of.log, step=of.step))


def parse_parameter(name: str, value: Any) -> Parameter:
    """Parse the parameter of a setting from YAML or an Optuna distribution.

    YAML has ``{<kind>: [low, high]}`` with the kind "float", "int" or "discount" and optional
    arguments of Optuna's distribution, or ``{"choice": values}``, a list or a mapping from labels.
    """
    if isinstance(value, Parameter):
        return value
    form = _form_of(value) if isinstance(value, optunas.BaseDistribution) else value
    try:
        with warnings.catch_warnings(action="error"):  # Optuna's when it lowers the upper end
            return _parsed(form)
    except (ArithmeticError, TypeError, UserWarning, ValueError) as error:
        raise ConfigError(
            f"Search space: {name!r}: {value!r} cannot be searched: {one_line(error).rstrip('.')}. "
            f"Expected {_FORMS}."
        ) from error


def _parsed(form: Any) -> Parameter:
    options = dict(form) if isinstance(form, Mapping) else {}
    found = [kind for kind in _KINDS if kind in options]
    if len(found) != 1:
        near = near_names(str(next(iter(options), "")), _KINDS)
        raise ValueError(f"it is no {', '.join(_KINDS[:-1])} or {_KINDS[-1]}.{near}")
    kind, given = found[0], options.pop(found[0])
    if kind == "choice":
        return _choice(given, **options)
    number = int if kind == "int" else float
    made: Any = optunas.IntDistribution if kind == "int" else optunas.FloatDistribution
    low, high = (coerce(end, number, kind) for end in given)
    if kind == "discount":
        if not 0 <= low < high < 1:
            raise ValueError("it is no range of numbers from 0 on, less than 1")
        ends = _distance_from_1(high), _distance_from_1(low)
        return Parameter({kind: [low, high]}, made(*ends, **options, log=True))
    if "step" in options:
        options["step"] = coerce(options["step"], number | None, "step")
    distribution = made(low, high, **options)
    return Parameter(_form_of(distribution), distribution)


def _form_of(distribution: Any) -> dict[str, Any]:
    if isinstance(distribution, optunas.CategoricalDistribution):
        return {"choice": list(distribution.choices)}
    is_int = isinstance(distribution, optunas.IntDistribution)
    form: dict[str, Any] = {"int" if is_int else "float": [distribution.low, distribution.high]}
    form |= {"log": True} if distribution.log else {}
    return form if distribution.step in (None, int(is_int)) else {**form, "step": distribution.step}


def _choice(given: Any) -> Parameter:
    values, by_stored = plain(given, "choice"), {}
    if isinstance(values, dict):
        by_stored = values
    elif isinstance(values, list):
        by_stored = {v if isinstance(v, str | int | float) else json.dumps(v): v for v in values}
    if len(by_stored) < 2 or len(by_stored) < len(values):
        raise ValueError("it has not two values or more, each once: a mapping gives them labels")
    distribution = optunas.CategoricalDistribution(tuple(by_stored))
    return Parameter({"choice": values}, distribution, by_stored)


def _distance_from_1(number: float) -> float:
    # Decimal, so that 0.8 becomes 0.2 rather than 0.19999999999999996, and 0.2 becomes 0.8.
    return float(1 - Decimal(str(number)))


class Space(dict[str, Parameter]):
    """Mapping from settings to parameters, or to Optuna's distributions.

    The names of settings are paths in an entry of an RL Zoo file: ``learning_rate``,
    ``policy_kwargs.net_arch``, ``env_kwargs.reward_weights.fingering``. A path such as
    ``env_wrapper.TemporalStretch.factor`` names an argument of the wrapper with that class name; a
    wrapper of ``sb3_piano.wrappers`` that the entry lacks is added outermost.

    Raises:
        ConfigError: If it is empty, or a parameter is not valid.
    """

    def __init__(self, parameters: Mapping[str, Any]):
        names = [str(name) for name in parameters] if isinstance(parameters, Mapping) else []
        if not names or any(name.partition(".")[0] in _SAME for name in names):
            raise ConfigError(
                f"Search space: {parameters!r} cannot be searched: expected a mapping from "
                "settings to parameters, such as {tau: {float: [0.001, 0.1], log: true}}, and none "
                f"of {', '.join(_SAME)}, which all trials share."
            )
        super().__init__({name: parse_parameter(name, form) for name, form in parameters.items()})

    @property
    def distributions(self) -> dict[str, optunas.BaseDistribution]:
        """Optuna's distributions by their stored names."""
        return {p.stored_name(name): p.distribution for name, p in self.items()}

    def suggest(self, trial: BaseTrial) -> dict[str, Any]:
        """Draw the settings of a trial, by name."""
        return {name: parameter.suggest(trial, name) for name, parameter in self.items()}

    def settings(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Return the settings for the ``params`` of a trial, if it has them."""
        stored = ((name, p, p.stored_name(name)) for name, p in self.items())
        return {name: p.value(params[key]) for name, p, key in stored if key in params}

    def params_of(self, algo: str, env_id: str, entry: Mapping[str, Any]) -> dict[str, Any]:
        """Return the params of a trial with the settings of an entry, including defaults.

        Values outside the space are left out. A choice matches if the run stays the same.
        """

        def run_with(name: str, value: Any) -> RunConfig | None:
            try:
                return entry_config(algo, env_id, with_settings(entry, {name: value}))
            except ConfigError:  # such as a default that YAML cannot hold
                return None

        def stored(name: str, parameter: Parameter) -> Any:
            value = setting_at(entry, name, setting_at(defaults, name))
            if parameter.choices is None:
                return parameter.stored(value)
            wanted, choices = run_with(name, value), parameter.choices.items()
            same = (key for key, choice in choices if run_with(name, choice) == wanted)
            return None if wanted is None else next(same, None)

        arguments = {name: p.default for name, p in parameters_of(algorithm_class(algo)).items()}
        env = PianoEnvConfig(reward_terms=setting_at(entry, "env_kwargs.reward_terms", {}))
        defaults = {**arguments, "policy": RunConfig.policy, "env_kwargs": vars(env)}
        found = {p.stored_name(name): stored(name, p) for name, p in self.items()}
        return {name: value for name, value in found.items() if value is not None}

    def to_mapping(self) -> dict[str, Any]:
        """Return the space in YAML's and JSON's types, from which it can be created again."""
        return {name: dict(parameter.form) for name, parameter in self.items()}


_GROUPS = read_yaml_mapping(Path(__file__).with_name("spaces.yml"))

SPACES = {name: Space(form) for name, form in _GROUPS.items() if not name.startswith("_")}
"""Spaces by the name of their algorithm; "env" and "reward" suit any algorithm."""


def load_space(sources: Sequence[str | os.PathLike[str]], algo: str) -> Space:
    """Load and join several spaces.

    Sources are names of this package's spaces, by default the algorithm's, or YAML files with
    parameters by setting; later sources replace parameters of earlier ones.

    Raises:
        ConfigError: If a space or file is unknown or not valid.
    """
    parameters: dict[str, Parameter] = {}
    for source in map(str, sources or (algo,)):
        if source not in SPACES and not Path(source).suffix and not os.path.exists(source):
            raise ConfigError(
                f"Unknown search space {source!r}.{near_names(source, SPACES)} Expected one of "
                f"{', '.join(SPACES)}, or a YAML file (--space)."
            )
        with naming(f"'{source}'"):
            parameters.update(SPACES.get(source) or Space(read_yaml_mapping(Path(source))))
    return Space(parameters)


def check_space(space: Space, algo: str, env_id: str, entry: Mapping[str, Any]) -> None:
    """Build environment and model of the entry at both ends of all ranges and with all choices."""
    extremes = {name: parameter.extremes() for name, parameter in space.items()}
    for index in range(-1, max(map(len, extremes.values()))):
        together = {name: ends[min(index, len(ends) - 1)] for name, ends in extremes.items()}
        settings = together if index >= 0 else {}  # check the entry alone first
        try:
            _build(entry_config(algo, env_id, with_settings(entry, settings)).alone())
        except Exception as error:  # environments and algorithms may raise anything
            of_ours = isinstance(error, SB3PianoError)
            reason = str(error) if of_ours else f"{type(error).__name__}: {error}"
            place = f"Search space, with {settings}: " if settings else ""
            raise ConfigError(f"{place}{reason}") from error


def _build(config: RunConfig) -> None:
    """Build environment and model as a check, the model with cheap settings."""
    cheap = {"device": "cpu", "verbose": 0, "buffer_size": 100}
    cheap = {k: v for k, v in cheap.items() if k in parameters_of(config.algorithm)}
    config = dataclasses.replace(config, algorithm_kwargs={**config.algorithm_kwargs, **cheap})
    quiet = warnings.catch_warnings(action="ignore")  # the trial's training shows them
    with quiet, contextlib.closing(build_vec_env(config)) as venv:
        build_model(config, venv)
        venv.reset()
