"""Checks of the arguments that wrappers get, often from YAML."""

from __future__ import annotations

from numbers import Integral
from typing import Any

from sb3_piano.exceptions import ConfigError


def whole_number(name: str, value: Any, minimum: int) -> int:
    """Return an argument as an int.

    Raises:
        ConfigError: If it is no whole number, or less than the minimum.
    """
    if isinstance(value, bool) or not isinstance(value, Integral) or value < minimum:
        raise ConfigError(f"{name} is {value!r}: expected a whole number, {minimum} or more.")
    return int(value)
