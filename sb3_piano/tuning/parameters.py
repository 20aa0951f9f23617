"""Parameters of a search space: a range or choices for one setting."""

from __future__ import annotations

import copy
import json
import math
import re
import typing
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from decimal import Decimal
from typing import Any, ClassVar

from optuna.distributions import (
    BaseDistribution,
    CategoricalDistribution,
    FloatDistribution,
    IntDistribution,
)
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.training.coerce import coerce
from sb3_piano.training.import_names import full_name
from sb3_piano.training.plain import plain
from sb3_piano.training.zoo_text import parse_zoo_text

Stored = str | int | float | bool
"""Types that Optuna's stores hold."""

_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")  # numbers that PyYAML reads as text


class Parameter(ABC):
    """Values of one setting that may be searched."""

    kind: ClassVar[str]
    """Its name in YAML."""

    @property
    @abstractmethod
    def distribution(self) -> BaseDistribution:
        """The same in Optuna's terms."""

    def stored_name(self, name: str) -> str:
        """Return the name in the store of the parameter of a setting."""
        return name

    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Return the value of the setting ``name`` in a trial."""
        name, of = self.stored_name(name), self.distribution
        if isinstance(of, FloatDistribution):
            return self.value(trial.suggest_float(name, of.low, of.high, log=of.log, step=of.step))
        if isinstance(of, IntDistribution):
            return self.value(trial.suggest_int(name, of.low, of.high, log=of.log, step=of.step))
        assert isinstance(of, CategoricalDistribution), "Optuna has no other kinds"
        return self.value(trial.suggest_categorical(name, of.choices))

    @abstractmethod
    def value(self, stored: Any) -> Any:
        """Return the value of the setting for the value in the store."""

    @abstractmethod
    def stored(self, value: Any) -> Stored | None:
        """Return the value in the store for one of the setting; ``None`` if it is not searched."""

    @abstractmethod
    def extremes(self) -> list[Any]:
        """Return the ends of a range, or all choices."""

    @abstractmethod
    def to_plain(self) -> dict[str, Any]:
        """Return the form in YAML; :func:`parse_parameter` gives the parameter back."""


class _Range(Parameter):
    """Numbers between ``low`` and ``high``, both included; numbers may be given as text."""

    low: float
    high: float

    def __post_init__(self) -> None:
        types = typing.get_type_hints(type(self))
        for option in fields(self):  # type: ignore[arg-type]  # each subclass is a dataclass
            value = coerce(getattr(self, option.name), types[option.name], option.name)
            object.__setattr__(self, option.name, value)
        if not self.low < self.high:
            raise ConfigError(
                f"low is {self.low} and high is {self.high}: expected low below high; a fixed "
                "value goes into the config."
            )
        self._check_distribution()

    def _check_distribution(self) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # as Optuna says that it lowers the upper end
                _ = self.distribution
        except (ArithmeticError, UserWarning, ValueError) as error:
            raise ConfigError(f"{self.to_plain()} is no range: {error}") from error

    def value(self, stored: Any) -> Any:
        """Return the number itself."""
        return type(self.low)(stored)

    def stored(self, value: Any) -> Any:
        """Return the number, also from text; ``None`` if it is outside or between two steps."""
        try:
            number = coerce(value, type(self.low), "")
        except ConfigError:
            return None
        steps = (number - self.low) / (getattr(self, "step", None) or math.inf)
        is_step = abs(steps - round(steps)) < 1e-8  # as Optuna compares
        return number if self.low <= number <= self.high and is_step else None

    def extremes(self) -> list[Any]:
        """Return the ends."""
        return [self.low, self.high]

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"float": [0.0001, 0.003], "log": True}``."""
        options = {
            option.name: getattr(self, option.name)
            for option in fields(self)  # type: ignore[arg-type]
            if option.kw_only and getattr(self, option.name) != option.default
        }
        return {self.kind: [self.low, self.high], **options}


@dataclass(frozen=True)
class Float(_Range):
    """A number between two others.

    Raises:
        ConfigError: If no range is left, or the options do not fit it.
    """

    kind: ClassVar[str] = "float"

    low: float
    """The least."""
    high: float
    """The greatest, above ``low``."""
    _: KW_ONLY
    log: bool = False
    """Whether to search evenly in its logarithm; ``low`` is above 0 then."""
    step: float | None = None
    """Search only numbers that are a multiple of it above ``low``; ``high`` has to be one."""

    @property
    def distribution(self) -> FloatDistribution:
        """The range in Optuna's terms."""
        return FloatDistribution(self.low, self.high, log=self.log, step=self.step)


@dataclass(frozen=True)
class Int(_Range):
    """A whole number between two others.

    Raises:
        ConfigError: If no range is left, or the options do not fit it.
    """

    kind: ClassVar[str] = "int"

    low: int
    """The least."""
    high: int
    """The greatest, above ``low``."""
    _: KW_ONLY
    log: bool = False
    """Whether to search evenly in its logarithm; ``low`` is above 0 then."""
    step: int = 1
    """Search only numbers that are a multiple of it above ``low``; ``high`` has to be one."""

    @property
    def distribution(self) -> IntDistribution:
        """The range in Optuna's terms."""
        return IntDistribution(self.low, self.high, log=self.log, step=self.step)


@dataclass(frozen=True)
class Discount(_Range):
    """A number below 1 that is searched evenly in the logarithm of its distance from 1.

    A discount factor of 0.9 looks 10 steps ahead, one of 0.99 a hundred: ``1 / (1 - gamma)``. The
    store holds that distance, named "1 - gamma".

    Raises:
        ConfigError: If no range is left within [0, 1).
    """

    kind: ClassVar[str] = "discount"

    low: float
    """The least, 0 or more."""
    high: float
    """The greatest, above ``low`` and below 1."""

    def _check_distribution(self) -> None:
        if self.low < 0 or self.high >= 1:
            raise ConfigError(
                f"discount is {[self.low, self.high]}: expected numbers from 0 on, less than 1."
            )

    @property
    def distribution(self) -> FloatDistribution:
        """The distances from 1."""
        return FloatDistribution(_distance_from_1(self.high), _distance_from_1(self.low), log=True)

    def stored_name(self, name: str) -> str:
        """Return, for example, "1 - gamma"."""
        return f"1 - {name}"

    def value(self, stored: Any) -> float:
        """Return the number that is this far from 1."""
        return min(max(_distance_from_1(stored), self.low), self.high)  # rounding may lead beyond

    def stored(self, value: Any) -> float | None:
        """Return the distance from 1 of a number, also from text; ``None`` if it is outside."""
        number = super().stored(value)
        return None if number is None else _distance_from_1(number)


@dataclass(frozen=True)
class Choice(Parameter):
    """One of several values.

    The store holds text, numbers and booleans as they are; for any other value the text that
    stands for it in JSON, such as "[256, 256]", or the label that it has in a mapping.

    Raises:
        ConfigError: If there are not two or more values, or two of them, or of their labels, are
            the same.
    """

    kind: ClassVar[str] = "choice"

    choices: Sequence[Any] | Mapping[str, Any]
    """The values, or labels and values; in YAML's types."""
    _by_stored: dict[Stored, Any] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.choices, str) or not isinstance(self.choices, (Sequence, Mapping)):
            raise ConfigError(
                f"choice is {self.choices!r}: expected a list of values, or a mapping from labels "
                "to values."
            )
        values = _with_numbers(plain(self.choices, "choice"))
        labelled = isinstance(values, Mapping)
        pairs = [*values.items()] if labelled else [(_label(value), value) for value in values]
        if len(pairs) < 2:
            raise ConfigError(
                f"choice is {values!r}: expected two values or more; a fixed value goes into the "
                "config."
            )
        for what in ([label for label, _ in pairs], [_normal(value) for _, value in pairs]):
            if any(what[i] == what[j] for j in range(len(what)) for i in range(j)):
                raise ConfigError(
                    f"choice is {values!r}: expected each value once, also in the store, which "
                    f"holds {', '.join(repr(label) for label, _ in pairs)}; a mapping gives labels."
                )
        object.__setattr__(self, "choices", values if labelled else tuple(values))
        object.__setattr__(self, "_by_stored", dict(pairs))

    @property
    def distribution(self) -> CategoricalDistribution:
        """The values in the store."""
        return CategoricalDistribution(tuple(self._by_stored))

    def value(self, stored: Any) -> Any:
        """Return a copy of the value for the one in the store."""
        return copy.deepcopy(self._by_stored[stored])

    def stored(self, value: Any) -> Stored | None:
        """Return the value in the store for a value, however it is written."""
        wanted = _normal(value)
        found = (stored for stored, one in self._by_stored.items() if _normal(one) == wanted)
        return next(found, None)

    def extremes(self) -> list[Any]:
        """Return all values."""
        return copy.deepcopy(list(self._by_stored.values()))

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"choice": [64, 128]}``."""
        return {self.kind: plain(self.choices, "choice")}


_KINDS: dict[str, type[Float | Int | Discount | Choice]] = {
    kind.kind: kind for kind in (Float, Int, Choice, Discount)
}
_FORMS = (
    "{float: [1.0e-4, 1.0e-3], log: true}, {int: [1, 10], step: 3}, {choice: [64, 128]}, "
    "{choice: {small: [64], large: [256, 256]}} or {discount: [0.6, 0.97]}"
)


def parse_parameter(name: str, value: Any) -> Parameter:
    """Return the parameter that YAML describes.

    Args:
        name: The setting's name, for messages.
        value: ``{<kind>: [low, high]}`` with the kind "float", "int" or "discount", or
            ``{"choice": values}``; beside it the options of the kind.

    Raises:
        ConfigError: If it is nothing like that, or the parameter is not valid.
    """
    try:
        return value if isinstance(value, Parameter) else _parsed(value)
    except ConfigError as error:
        raise ConfigError(f"Search space: {name!r}: {error}") from error


def _parsed(value: Any) -> Parameter:
    found = [kind for kind in _KINDS if kind in value] if isinstance(value, Mapping) else []
    if len(found) != 1:
        first = str(next(iter(value), "")) if isinstance(value, Mapping) else ""
        suggestion = "" if found else near_names(first, _KINDS)
        raise ConfigError(f"{value!r} cannot be searched.{suggestion} Expected {_FORMS}.")
    kind = _KINDS[found[0]]
    given = value[found[0]]
    options = {name: value[name] for name in value if name != found[0]}
    known = [option.name for option in fields(kind) if option.kw_only]
    for option in options:
        if option not in known:
            raise ConfigError(
                f"Unknown option {option!r} of {found[0]}.{near_names(str(option), known)} "
                f"Expected {' or '.join(known) or 'none'}."
            )
    if kind is Choice:
        return Choice(given)
    if not isinstance(given, (list, tuple)) or len(given) != 2:
        raise ConfigError(f"{found[0]} is {given!r}: expected [low, high].")
    return kind(*given, **options)


def _distance_from_1(number: float) -> float:
    # Decimal, so that 0.8 becomes 0.2 rather than 0.19999999999999996, and 0.2 becomes 0.8.
    return float(1 - Decimal(str(number)))


def _with_numbers(value: Any) -> Any:
    """Return a copy in which text that YAML 1.2 takes for a number has become one."""
    if isinstance(value, dict):
        return {name: _with_numbers(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_with_numbers(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"choice has {value}: expected finite numbers.")
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value


def _label(value: Any) -> Stored:
    """Return the value in the store of one that has no label."""
    return value if isinstance(value, Stored) else json.dumps(value)


def _normal(value: Any) -> Any:
    """Return a form that is the same for all ways to write a value."""
    try:
        if isinstance(value, str) and value.startswith("dict("):
            value = parse_zoo_text(value)
        if not isinstance(value, (bool, Mapping, list, tuple)):
            return coerce(value, float, "")
    except ConfigError:
        pass  # some other text
    if isinstance(value, Mapping):
        return {name: _normal(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_normal(item) for item in value]
    if isinstance(value, bool):
        return str(value), bool
    return full_name(value) if isinstance(value, str) else value
