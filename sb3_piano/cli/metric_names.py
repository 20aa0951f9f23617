"""Metrics in the words of the tables."""

from __future__ import annotations

from sb3_piano.exceptions import ConfigError, near_names
from sb3_piano.metrics import DEFINITIONS


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
    known = DEFINITIONS.get(name)
    return name if known is None else _with_unit(known.label, known.unit)


def short_label(name: str) -> str:
    """Return what a metric is called under the heading of its section."""
    known = DEFINITIONS[name]
    return _with_unit(known.short, known.unit)


def _with_unit(text: str, unit: str) -> str:
    if unit.startswith("/"):
        return text + unit
    return f"{text}, {unit}" if unit else text


def rounded(name: str, value: float) -> str:
    """Return the value of a metric with its number of decimals."""
    known = DEFINITIONS.get(name)
    return f"{value:.3f}" if known is None else known.rounded(value)
