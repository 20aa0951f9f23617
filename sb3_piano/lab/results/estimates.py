"""Means over rollouts with standard errors, rounded to significant decimals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean, stdev
from typing import NamedTuple


class Estimate(NamedTuple):
    """A mean over rollouts."""

    mean: float
    error: float | None
    """Standard error of the mean; ``None`` for a single rollout."""

    @classmethod
    def of(cls, values: Sequence[float]) -> Estimate:
        """Return the mean over rollouts of one piece."""
        error = stdev(values) / math.sqrt(len(values)) if len(values) > 1 else None
        return cls(fmean(values), error)

    @classmethod
    def average(cls, estimates: Sequence[Estimate]) -> Estimate:
        """Return the mean over pieces, with the standard error from their rollouts."""
        errors = [each.error for each in estimates if each.error is not None]
        error = math.hypot(*errors) / len(errors) if len(errors) == len(estimates) else None
        return cls(fmean(each.mean for each in estimates), error)

    def __str__(self) -> str:
        if self.error is None:
            return f"{self.mean:.2f}"
        digits = decimals(self.error)
        return f"{self.mean:.{digits}f} ± {self.error:.{digits}f}"


def decimals(error: float) -> int:
    """Return the number of significant decimals of a score: 3 if its error is below 0.005."""
    return 3 if error < 0.005 else 2
