"""Parameters of a search space: Optuna's distributions, as YAML writes them."""

from __future__ import annotations

import copy
import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.settings import refuse_unknown
from sb3_piano.training.configuration.names import full_name
from sb3_piano.training.configuration.values import coerce, parse_zoo_text, plain

Distribution = FloatDistribution | IntDistribution | CategoricalDistribution

_FORMS = (
    "{float: [1.0e-4, 1.0e-3], log: true}, {int: [1, 10], step: 3}, {choice: [64, 128]}, "
    "{choice: {small: [64], large: [256, 256]}} or {discount: [0.6, 0.97]}"
)
_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "float": {"log": bool, "step": float | None},
    "int": {"log": bool, "step": int},
    "discount": {},
    "choice": {},
}
"""Options of each kind of parameter, and their types."""


@dataclass(frozen=True)
class Parameter:
    """A distribution of Optuna's, and what the values in the store stand for.

    The store holds a discount as its distance from 1, named "1 - gamma": a discount factor of 0.9
    looks 10 steps ahead, one of 0.99 a hundred, and ranges are even in the logarithm of that. Of
    choices it holds text, numbers and booleans as they are; for any other value the text that
    stands for it in JSON, such as "[256, 256]", or the label that it has in a mapping.
    """

    form: Mapping[str, Any]
    """The parameter in YAML's types; :func:`parse_parameter` gives it back."""
    distribution: Distribution
    """Optuna's distribution of the values in the store."""
    choices: Mapping[Any, Any] | None = None
    """The value of each choice in the store."""

    def stored_name(self, name: str) -> str:
        """Return the name in the store of the parameter of a setting."""
        return f"1 - {name}" if "discount" in self.form else name

    def value(self, stored: Any) -> Any:
        """Return the value of the setting for the value in the store."""
        if self.choices is not None:
            return copy.deepcopy(self.choices[stored])
        if "discount" not in self.form:
            return stored
        low, high = self.form["discount"]
        return min(max(_distance_from_1(stored), low), high)  # rounding may lead beyond

    def stored(self, value: Any) -> Any:
        """Return the value in the store for one, however written; ``None`` if not searched."""
        of = self.distribution
        if isinstance(of, CategoricalDistribution):
            wanted, choices = _normal(value), self.choices or {}
            return next((key for key, one in choices.items() if _normal(one) == wanted), None)
        try:
            number = coerce(value, int if isinstance(of, IntDistribution) else float, "")
        except ConfigError:
            return None
        number = _distance_from_1(number) if "discount" in self.form else number
        steps = (number - of.low) / (of.step or math.inf)
        is_step = abs(steps - round(steps)) < 1e-8  # as Optuna compares
        return number if of.low <= number <= of.high and is_step else None

    def extremes(self) -> list[Any]:
        """Return the values at the ends of a range, or all choices."""
        of = self.distribution
        ends = of.choices if isinstance(of, CategoricalDistribution) else (of.low, of.high)
        return [self.value(end) for end in ends]

    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Return the value of the setting ``name`` in a trial."""
        name, of = self.stored_name(name), self.distribution
        if isinstance(of, CategoricalDistribution):
            return self.value(trial.suggest_categorical(name, of.choices))
        draw: Any = trial.suggest_int if isinstance(of, IntDistribution) else trial.suggest_float
        return self.value(draw(name, of.low, of.high, log=of.log, step=of.step))


def parse_parameter(name: str, value: Any) -> Parameter:
    """Return the parameter of a setting: a distribution of Optuna's, or what YAML says of one.

    That is ``{<kind>: [low, high]}`` with the kind "float", "int" or "discount", beside it the
    options of the kind, or ``{"choice": values}``, a list or a mapping from labels to values.

    Raises:
        ConfigError: If it is nothing like that, or the range or the choices are not valid.
    """
    if isinstance(value, Parameter):
        return value
    form = _form_of(value) if isinstance(value, Distribution) else value
    options = dict(form) if isinstance(form, Mapping) else {}
    found = [kind for kind in _OPTIONS if kind in options]
    try:
        if len(found) != 1:
            suggestion = "" if found else near_names(str(next(iter(options), "")), _OPTIONS)
            raise ConfigError(f"{value!r} cannot be searched.{suggestion} Expected {_FORMS}.")
        kind, given = found[0], options.pop(found[0])
        refuse_unknown(options, _OPTIONS[kind] or ["none"], "option", kind)
        return _choice(given) if kind == "choice" else _range(kind, given, options)
    except ConfigError as error:
        raise ConfigError(f"Search space: {name!r}: {error}") from error


def _form_of(distribution: Distribution) -> dict[str, Any]:
    if isinstance(distribution, CategoricalDistribution):
        return {"choice": list(distribution.choices)}
    kind = "int" if isinstance(distribution, IntDistribution) else "float"
    ends = [distribution.low, distribution.high]
    return {kind: ends, "log": distribution.log, "step": distribution.step}


def _range(kind: str, ends: Any, options: Mapping[str, Any]) -> Parameter:
    if not isinstance(ends, (list, tuple)) or len(ends) != 2:
        raise ConfigError(f"{kind} is {ends!r}: expected [low, high].")
    number = int if kind == "int" else float
    low, high = (coerce(end, number, of) for end, of in zip(ends, ("low", "high"), strict=True))
    read = {name: coerce(value, _OPTIONS[kind][name], name) for name, value in options.items()}
    defaults = (("log", False), ("step", 1 if kind == "int" else None))
    form = {kind: [low, high], **{n: v for n, v in read.items() if (n, v) not in defaults}}
    try:
        if not low < high:
            raise ValueError("expected low below high; a fixed value goes into the config")
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # as Optuna says that it lowers the upper end
            return Parameter(form, _distribution(kind, low, high, read))
    except (ArithmeticError, UserWarning, ValueError) as error:
        raise ConfigError(f"{form} is no range: {error}.") from error


def _distribution(kind: str, low: Any, high: Any, options: Mapping[str, Any]) -> Distribution:
    if kind == "int":
        return IntDistribution(low, high, **options)
    if kind == "float":
        return FloatDistribution(low, high, **options)
    if low < 0 or high >= 1:
        raise ValueError("expected numbers from 0 on, less than 1")
    return FloatDistribution(_distance_from_1(high), _distance_from_1(low), log=True)


def _choice(given: Any) -> Parameter:
    if isinstance(given, str) or not isinstance(given, (Sequence, Mapping)):
        raise ConfigError(
            f"choice is {given!r}: expected a list of values, or a mapping from labels to values."
        )
    values = plain(given, "choice")
    scalar = str | bool | int | float
    listed = {} if isinstance(values, dict) else values
    by_stored = {v if isinstance(v, scalar) else json.dumps(v): v for v in listed} or values
    if len(values) < 2 or len(by_stored) < len(values):
        raise ConfigError(
            f"choice is {values!r}: expected two values or more, each once and with a text of its "
            "own in the store, for which a mapping gives labels; a fixed value goes into the "
            "config."
        )
    return Parameter({"choice": values}, CategoricalDistribution(tuple(by_stored)), by_stored)


def _distance_from_1(number: float) -> float:
    # Decimal, so that 0.8 becomes 0.2 rather than 0.19999999999999996, and 0.2 becomes 0.8.
    return float(1 - Decimal(str(number)))


def _normal(value: Any) -> Any:
    """Return a form that is the same for all ways to write a value."""
    if isinstance(value, bool):
        return str(value), bool
    try:
        if isinstance(value, str) and value.startswith("dict("):
            value = parse_zoo_text(value)
        if isinstance(value, Mapping):
            return {name: _normal(item) for name, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [_normal(item) for item in value]
        return coerce(value, float, "")
    except ConfigError:  # some other text
        return full_name(value) if isinstance(value, str) else value
