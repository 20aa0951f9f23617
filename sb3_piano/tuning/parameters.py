"""Parameters of a search space: a range or choices for one setting."""

from __future__ import annotations

import copy
import json
import math
import typing
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields
from decimal import Decimal
from typing import Any, ClassVar

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


class Parameter:
    """Values of one setting that may be searched."""

    kind: ClassVar[str]
    """Its name in YAML."""

    @property
    def distribution(self) -> Distribution:
        """The same in Optuna's terms."""
        raise NotImplementedError

    def stored_name(self, name: str) -> str:
        """Return the name in the store of the parameter of a setting."""
        return name

    def value(self, stored: Any) -> Any:
        """Return the value of the setting for the value in the store."""
        return stored

    def stored(self, value: Any) -> Any:
        """Return the value in the store for one, however written; ``None`` if not searched."""
        raise NotImplementedError

    def extremes(self) -> list[Any]:
        """Return the ends of a range, or all choices."""
        of = self.distribution
        ends = of.choices if isinstance(of, CategoricalDistribution) else (of.low, of.high)
        return [self.value(end) for end in ends]

    def to_plain(self) -> dict[str, Any]:
        """Return the form in YAML; :func:`parse_parameter` gives the parameter back."""
        raise NotImplementedError

    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Return the value of the setting ``name`` in a trial."""
        name, of = self.stored_name(name), self.distribution
        if isinstance(of, CategoricalDistribution):
            return self.value(trial.suggest_categorical(name, of.choices))
        draw: Any = trial.suggest_int if isinstance(of, IntDistribution) else trial.suggest_float
        return self.value(draw(name, of.low, of.high, log=of.log, step=of.step))


@dataclass(frozen=True)
class Float(Parameter):
    """A number between two others; all may be given as text.

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

    def __post_init__(self) -> None:
        types = typing.get_type_hints(type(self))
        for option in fields(self):
            value = coerce(getattr(self, option.name), types[option.name], option.name)
            object.__setattr__(self, option.name, value)
        try:
            if not self.low < self.high:
                raise ValueError("expected low below high; a fixed value goes into the config")
            with warnings.catch_warnings():
                warnings.simplefilter("error")  # as Optuna says that it lowers the upper end
                _ = self.distribution
        except (ArithmeticError, UserWarning, ValueError) as error:
            raise ConfigError(f"{self.to_plain()} is no range: {error}.") from error

    @property
    def distribution(self) -> FloatDistribution | IntDistribution:
        """The range."""
        return FloatDistribution(self.low, self.high, log=self.log, step=self.step)

    def stored(self, value: Any) -> Any:
        """Return the number, also from text; ``None`` if it is outside or between two steps."""
        try:
            number = coerce(value, type(self.low), "")
        except ConfigError:
            return None
        steps = (number - self.low) / (self.step or math.inf)
        is_step = abs(steps - round(steps)) < 1e-8  # as Optuna compares
        return number if self.low <= number <= self.high and is_step else None

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"float": [0.0001, 0.003], "log": True}``."""
        given = {option: getattr(self, option.name) for option in _options(type(self))}
        options = {option.name: v for option, v in given.items() if v != option.default}
        return {self.kind: [self.low, self.high], **options}


@dataclass(frozen=True)
class Int(Float):
    """A whole number between two others; the options are those of :class:`Float`.

    Raises:
        ConfigError: If no range is left, or the options do not fit it.
    """

    kind: ClassVar[str] = "int"

    low: int
    high: int
    _: KW_ONLY
    step: int = 1

    @property
    def distribution(self) -> IntDistribution:
        """The range."""
        return IntDistribution(self.low, self.high, log=self.log, step=self.step)


@dataclass(frozen=True)
class Discount(Float):
    """A number from 0 on and below 1, searched evenly in the logarithm of its distance from 1.

    A discount factor of 0.9 looks 10 steps ahead, one of 0.99 a hundred: ``1 / (1 - gamma)``. The
    store holds that distance, named "1 - gamma".

    Raises:
        ConfigError: If no range is left within [0, 1).
    """

    kind: ClassVar[str] = "discount"

    log: bool = field(default=True, init=False)
    step: None = field(default=None, init=False)

    @property
    def distribution(self) -> FloatDistribution:
        """The distances from 1."""
        if self.low < 0 or self.high >= 1:
            raise ValueError("expected numbers from 0 on, less than 1")
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
        ConfigError: If there are not two or more values, or two of them are the same there.
    """

    kind: ClassVar[str] = "choice"

    choices: Sequence[Any] | Mapping[str, Any]
    """The values, or labels and values; in YAML's types."""

    def __post_init__(self) -> None:
        if isinstance(self.choices, str) or not isinstance(self.choices, (Sequence, Mapping)):
            raise ConfigError(
                f"choice is {self.choices!r}: expected a list of values, or a mapping from labels "
                "to values."
            )
        values = plain(self.choices, "choice")
        object.__setattr__(self, "choices", values if isinstance(values, dict) else tuple(values))
        if len(self.choices) < 2 or len(self._by_stored) < len(self.choices):
            raise ConfigError(
                f"choice is {values!r}: expected two values or more, each once and with a text of "
                "its own in the store, for which a mapping gives labels; a fixed value goes into "
                "the config."
            )

    @property
    def _by_stored(self) -> dict[Any, Any]:
        if isinstance(self.choices, Mapping):
            return dict(self.choices)
        scalar = str | bool | int | float
        return {v if isinstance(v, scalar) else json.dumps(v): v for v in self.choices}

    @property
    def distribution(self) -> CategoricalDistribution:
        """The values in the store."""
        return CategoricalDistribution(tuple(self._by_stored))

    def value(self, stored: Any) -> Any:
        """Return a copy of the value for the one in the store."""
        return copy.deepcopy(self._by_stored[stored])

    def stored(self, value: Any) -> Any:
        """Return the value in the store for a value, however it is written."""
        wanted = _normal(value)
        found = (stored for stored, one in self._by_stored.items() if _normal(one) == wanted)
        return next(found, None)

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"choice": [64, 128]}``."""
        return {self.kind: plain(self.choices, "choice")}


_KINDS: Mapping[str, type[Float | Choice]] = {
    kind.kind: kind for kind in (Float, Int, Choice, Discount)
}


def parse_parameter(name: str, value: Any) -> Parameter:
    """Return the parameter of a setting that YAML describes.

    That is ``{<kind>: [low, high]}`` with the kind "float", "int" or "discount", or
    ``{"choice": values}``; beside it the options of the kind.

    Raises:
        ConfigError: If it is nothing like that, or the parameter is not valid.
    """
    if isinstance(value, Parameter):
        return value
    options = dict(value) if isinstance(value, Mapping) else {}
    found = [kind for kind in _KINDS if kind in options]
    try:
        if len(found) != 1:
            suggestion = "" if found else near_names(str(next(iter(options), "")), _KINDS)
            raise ConfigError(f"{value!r} cannot be searched.{suggestion} Expected {_FORMS}.")
        kind, given = _KINDS[found[0]], options.pop(found[0])
        refuse_unknown(options, [o.name for o in _options(kind)] or ["none"], "option", found[0])
        if issubclass(kind, Choice):
            return kind(given)
        if not isinstance(given, (list, tuple)) or len(given) != 2:
            raise ConfigError(f"{found[0]} is {given!r}: expected [low, high].")
        return kind(*given, **options)
    except ConfigError as error:
        raise ConfigError(f"Search space: {name!r}: {error}") from error


def _options(kind: type[Float | Choice]) -> list[Any]:
    return [option for option in fields(kind) if option.kw_only]


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
