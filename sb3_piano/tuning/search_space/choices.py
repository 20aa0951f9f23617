"""Values of which one may be chosen."""

from __future__ import annotations

import copy
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from optuna.distributions import CategoricalDistribution
from optuna.trial import BaseTrial

from sb3_piano.exceptions import ConfigError
from sb3_piano.training.configuration.names import full_name
from sb3_piano.training.configuration.values import parse_zoo_text, plain
from sb3_piano.tuning.search_space.parameter import Parameter, Stored, as_number

# Numbers of which PyYAML makes text.
_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


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
        _check_distinct(pairs)
        object.__setattr__(self, "choices", values if labelled else tuple(values))
        object.__setattr__(self, "_by_stored", dict(pairs))

    @property
    def distribution(self) -> CategoricalDistribution:
        """What the store holds for the values."""
        return CategoricalDistribution(tuple(self._by_stored))

    def suggest(self, trial: BaseTrial, name: str) -> Any:
        """Return the value of the setting ``name`` in a trial."""
        return self.value(trial.suggest_categorical(name, tuple(self._by_stored)))

    def value(self, stored: Any) -> Any:
        """Return a copy of the value for what the store holds."""
        return copy.deepcopy(self._by_stored[stored])

    def stored(self, value: Any) -> Stored | None:
        """Return what the store holds for a value, however it is written; ``None`` for others."""
        wanted = _normal(value)
        for stored, choice in self._by_stored.items():
            if _normal(choice) == wanted:
                return stored
        return None

    def extremes(self) -> list[Any]:
        """Return all values."""
        return copy.deepcopy(list(self._by_stored.values()))

    def to_plain(self) -> dict[str, Any]:
        """Return, for example, ``{"choice": [64, 128]}``."""
        return {self.kind: plain(self.choices, "choice")}


def _with_numbers(value: Any) -> Any:
    """Return a copy in which text that YAML 1.2 takes for a number has become one."""
    if isinstance(value, dict):
        return {name: _with_numbers(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_with_numbers(item) for item in value]
    return float(value) if isinstance(value, str) and _EXPONENT.fullmatch(value) else value


def _label(value: Any) -> Stored:
    """Return what the store holds for a value that has no label."""
    return value if isinstance(value, (str, bool, int, float)) else json.dumps(value)


def _check_distinct(pairs: Sequence[tuple[Stored, Any]]) -> None:
    for index, (label, value) in enumerate(pairs):
        if isinstance(value, float) and not math.isfinite(value):
            raise ConfigError(f"choice has {value}: expected finite numbers.")
        for other_label, other in pairs[:index]:
            if _normal(value) == _normal(other):
                raise ConfigError(f"choice has {other!r} and {value!r}: expected each only once.")
            if label == other_label:  # also True and 1, which Optuna does not tell apart
                raise ConfigError(
                    f"choice has {other!r} and {value!r}, both {label!r} in the store: expected a "
                    "mapping that gives each a label of its own."
                )


def _normal(value: Any) -> Any:
    """Return a form that is the same for all ways to write a value."""
    if isinstance(value, str) and value.startswith("dict("):
        value = _parsed_text(value)
    if isinstance(value, Mapping):
        return {name: _normal(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_normal(item) for item in value]
    if isinstance(value, bool):
        return str(value), bool
    number = as_number(value)
    if number is not None:
        return number
    return full_name(value) if isinstance(value, str) else value


def _parsed_text(text: str) -> Any:
    try:
        return parse_zoo_text(text)
    except ConfigError:
        return text
