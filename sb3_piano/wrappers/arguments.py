"""Checks of the arguments that wrappers get, often from YAML."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import Any

from sb3_piano.exceptions import ConfigError


def finite_number(name: str, value: Any) -> float:
    """Return an argument as a float.

    Raises:
        ConfigError: If it is no finite number.
    """
    if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value):
        raise ConfigError(f"{name} is {value!r}: expected a finite number.")
    return float(value)


def whole_number(name: str, value: Any, minimum: int) -> int:
    """Return an argument as an int.

    Raises:
        ConfigError: If it is no whole number, or less than the minimum.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < minimum:
        raise ConfigError(f"{name} is {value!r}: expected a whole number, {minimum} or more.")
    return int(value)
