"""Ranges of numbers that may be searched."""

from __future__ import annotations

import decimal
from dataclasses import KW_ONLY, dataclass, fields
from decimal import Decimal
from typing import Any, ClassVar

from optuna.distributions import FloatDistribution, IntDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.values import coerce
from sb3_piano.tuning.search_space.parameter import Parameter, as_number


@dataclass(frozen=True)
class Float(Parameter):
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

    def __post_init__(self) -> None:
        _set_numbers(self, float)
        _check_range(self.low, self.high, log=self.log)
        if self.step is not None:
            _check_step(self.low, self.high, self.step, log=self.log)

    @property
    def distribution(self) -> FloatDistribution:
        """The range in Optuna's words."""
        return FloatDistribution(self.low, self.high, log=self.log, step=self.step)

    def suggest(self, trial: BaseTrial, name: str) -> float:
        """Return the value of the setting ``name`` in a trial."""
        return trial.suggest_float(name, self.low, self.high, log=self.log, step=self.step)

    def value(self, stored: Any) -> float:
        """Return the number itself."""
        return float(stored)

    def stored(self, value: Any) -> float | None:
        """Return the number, also from text; ``None`` if it is outside or between two steps."""
        number = as_number(value)
        if number is None or not self.low <= number <= self.high:
            return None
        steps = 0.0 if self.step is None else (number - self.low) / self.step
        return number if abs(steps - round(steps)) < 1e-8 else None  # as Optuna compares

    def extremes(self) -> list[Any]:
        """Return the ends."""
        return [self.low, self.high]

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"float": [0.0001, 0.003], "log": True}``."""
        return _range_to_plain(self)


@dataclass(frozen=True)
class Int(Parameter):
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

    def __post_init__(self) -> None:
        _set_numbers(self, int)
        _check_range(self.low, self.high, log=self.log)
        if self.step != 1:
            _check_step(self.low, self.high, self.step, log=self.log)

    @property
    def distribution(self) -> IntDistribution:
        """The range in Optuna's words."""
        return IntDistribution(self.low, self.high, log=self.log, step=self.step)

    def suggest(self, trial: BaseTrial, name: str) -> int:
        """Return the value of the setting ``name`` in a trial."""
        return trial.suggest_int(name, self.low, self.high, log=self.log, step=self.step)

    def value(self, stored: Any) -> int:
        """Return the number itself."""
        return int(stored)

    def stored(self, value: Any) -> int | None:
        """Return the number, also from text; ``None`` if it is outside or between two steps."""
        number = as_number(value)
        if number is None or number != int(number) or not self.low <= number <= self.high:
            return None
        return int(number) if (int(number) - self.low) % self.step == 0 else None

    def extremes(self) -> list[Any]:
        """Return the ends."""
        return [self.low, self.high]

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"int": [1, 9], "step": 2}``."""
        return _range_to_plain(self)


@dataclass(frozen=True)
class Discount(Parameter):
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

    def __post_init__(self) -> None:
        _set_numbers(self, float)
        for name, number in (("low", self.low), ("high", self.high)):
            if not 0 <= number < 1:
                raise ConfigError(f"{name} is {number}: expected 0 or more, and less than 1.")
        _check_range(self.low, self.high)

    @property
    def distribution(self) -> FloatDistribution:
        """The distances from 1."""
        return FloatDistribution(_distance_from_1(self.high), _distance_from_1(self.low), log=True)

    def stored_name(self, name: str) -> str:
        """Return, for example, "1 - gamma"."""
        return f"1 - {name}"

    def suggest(self, trial: BaseTrial, name: str) -> float:
        """Return the value of the setting ``name`` in a trial."""
        distances = self.distribution
        return self.value(
            trial.suggest_float(self.stored_name(name), distances.low, distances.high, log=True)
        )

    def value(self, stored: Any) -> float:
        """Return the number that is this far from 1."""
        # Rounding may lead beyond the ends.
        return min(max(_distance_from_1(stored), self.low), self.high)

    def stored(self, value: Any) -> float | None:
        """Return the distance from 1 of a number, also from text; ``None`` if it is outside."""
        number = as_number(value)
        if number is None or not self.low <= number <= self.high:
            return None
        return _distance_from_1(number)

    def extremes(self) -> list[Any]:
        """Return the ends."""
        return [self.low, self.high]

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"discount": [0.6, 0.97]}``."""
        return _range_to_plain(self)


def _set_numbers(parameter: Float | Int | Discount, kind: type) -> None:
    """Convert the fields of a range; they may be text, as PyYAML reads 1e-4."""
    for option in fields(parameter):
        value = getattr(parameter, option.name)
        if option.name == "step" and value is None and kind is float:
            continue
        fitting = coerce(value, bool if option.name == "log" else kind, option.name)
        object.__setattr__(parameter, option.name, fitting)


def _check_range(low: float, high: float, *, log: bool = False) -> None:
    if not low < high:
        raise ConfigError(
            f"low is {low} and high is {high}: expected low below high; a fixed value goes into "
            "the config."
        )
    if log and low <= 0:
        raise ConfigError(f"low is {low} with log: expected more than 0.")


def _check_step(low: float, high: float, step: float, *, log: bool) -> None:
    if log:
        raise ConfigError(f"step is {step} with log: expected one of them alone.")
    if step <= 0:
        raise ConfigError(f"step is {step}: expected more than 0.")
    try:
        # Decimal, as Optuna has it: 0.1 has to lead from 0 to 1.
        rest = (Decimal(str(high)) - Decimal(str(low))) % Decimal(str(step))
    except decimal.InvalidOperation:  # so many steps that their number has more than 28 digits
        rest = Decimal(1)
    if rest != 0:
        raise ConfigError(f"step is {step}: expected one that leads from {low} to {high}.")


def _range_to_plain(parameter: Float | Int | Discount) -> dict[str, Any]:
    options = {
        option.name: getattr(parameter, option.name)
        for option in fields(parameter)
        if option.kw_only and getattr(parameter, option.name) != option.default
    }
    return {parameter.kind: [parameter.low, parameter.high], **options}


def _distance_from_1(number: float) -> float:
    # Decimal, so that 0.8 becomes 0.2 rather than 0.19999999999999996, and 0.2 becomes 0.8.
    return float(1 - Decimal(str(number)))
