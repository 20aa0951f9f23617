"""What all parameters of a search space have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from optuna.distributions import BaseDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.values import coerce

Stored = str | int | float | bool
"""What Optuna's stores hold."""


class Parameter(ABC):
    """What may be searched of one setting."""

    kind: ClassVar[str]
    """What YAML calls it."""

    @property
    @abstractmethod
    def distribution(self) -> BaseDistribution:
        """What Optuna's store holds about it."""

    def stored_name(self, name: str) -> str:
        """Return what the parameter of a setting is called in the store."""
        return name

    @abstractmethod
    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Return the value of the setting ``name`` in a trial."""

    @abstractmethod
    def value(self, stored: Any) -> Any:
        """Return the value of the setting for what the store holds."""

    @abstractmethod
    def stored(self, value: Any) -> Stored | None:
        """Return what the store holds for a value; ``None`` if it is none of those searched."""

    @abstractmethod
    def extremes(self) -> list[Any]:
        """Return the ends of a range, or all choices."""

    @abstractmethod
    def to_plain(self) -> dict[str, Any]:
        """Return the form in YAML; :func:`parse_parameter` gives the parameter back."""


def as_number(value: Any) -> float | None:
    """Return a finite number, also from text; ``None`` for anything else."""
    try:
        return float(coerce(value, float, ""))
    except ConfigError:
        return None
