"""Metrics in the words of the tables."""

from __future__ import annotations

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.metrics import DEFINITIONS, Definition


def check_metric_names(names: list[str]) -> None:
    """Refuse names of metrics that do not exist.

    Raises:
        ConfigError: If there is one.
    """
    for name in names:
        if name not in DEFINITIONS:
            raise ConfigError(
                f"Unknown metric {name!r}.{near_names(name, DEFINITIONS)} Expected one of "
                f"{', '.join(DEFINITIONS)}."
            )


def label(name: str) -> str:
    """Return what a metric is called where it stands alone; one from elsewhere by its name."""
    known = _definition(name)
    return _with_unit(known.label, known.unit)


def short_label(name: str) -> str:
    """Return what a metric is called under the heading of its section."""
    known = _definition(name)
    return _with_unit(known.short, known.unit)


def rounded(name: str, value: float) -> str:
    """Return the value of a metric with its number of decimals."""
    return _definition(name).rounded(value)


def _definition(name: str) -> Definition:
    return DEFINITIONS.get(name, Definition(name, "", name, "", name))


def _with_unit(text: str, unit: str) -> str:
    if unit.startswith("/"):
        return text + unit
    return f"{text}, {unit}" if unit else text
