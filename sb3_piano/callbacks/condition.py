"""The condition that ends a training: evaluations are high enough for long enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sb3_piano.exceptions import ConfigError
from sb3_piano.settings import Count, Number, settings


@settings
class Condition:
    """Thresholds of metrics, and the number of evaluations in a row that must reach them.

    Raises:
        ConfigError: If no metric is named, or a number is out of range.
    """

    thresholds: Mapping[str, Number]
    """Least value of each metric; all of them must be reached."""
    patience: Count = 1
    """Number of evaluations in a row that must reach them."""
    eval_freq: Count | None = None
    """Calls between two evaluations, as of the callback, whose own it replaces: environment steps
    over the number of environments, or of hands where they are agents."""

    def __post_init__(self) -> None:
        if not self.thresholds:
            raise ConfigError("until names no metric: expected one or more, as in onset_f1: 0.8.")

    def is_met(self, evaluations: Sequence[Mapping[str, float]]) -> bool:
        """Return whether the last evaluations (the oldest first) all reach the thresholds.

        One that lacks a metric is not.
        """
        last = evaluations[-self.patience :]
        return len(last) == self.patience and all(
            found.get(name, float("-inf")) >= least
            for found in last
            for name, least in self.thresholds.items()
        )
