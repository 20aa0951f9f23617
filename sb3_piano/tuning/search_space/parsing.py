"""The parameters of a search space, and their form in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.tuning.search_space.choices import Choice
from sb3_piano.tuning.search_space.parameter import Parameter
from sb3_piano.tuning.search_space.ranges import Discount, Float, Int

__all__ = ["Choice", "Discount", "Float", "Int", "Parameter", "parse_parameter"]

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
    if not isinstance(value, Mapping) or not value:
        raise ConfigError(f"{value!r} cannot be searched: expected {_FORMS}.")
    found = [kind for kind in _KINDS if kind in value]
    if not found:
        suggestion = near_names(str(next(iter(value))), _KINDS)
        raise ConfigError(f"{dict(value)!r} has no known kind.{suggestion} Expected {_FORMS}.")
    if len(found) > 1:
        raise ConfigError(f"{dict(value)!r} has {' and '.join(found)}: expected one of them.")
    kind, given = found[0], value[found[0]]
    options = _checked_options(kind, {name: value[name] for name in value if name != kind})
    if kind == "choice":
        return Choice(given)
    if not isinstance(given, (list, tuple)) or len(given) != 2:
        raise ConfigError(f"{kind} is {given!r}: expected [low, high].")
    return _KINDS[kind](*given, **options)


def _checked_options(kind: str, options: dict[Any, Any]) -> dict[str, Any]:
    known = [option.name for option in fields(_KINDS[kind]) if option.kw_only]
    for option in options:
        if option not in known:
            raise ConfigError(
                f"Unknown option {option!r} of {kind}.{near_names(str(option), known)} Expected "
                f"{' or '.join(known) or 'none'}."
            )
    return options
