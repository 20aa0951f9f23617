"""Means of roll-outs, their errors, and as many of their digits as hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import fmean, stdev
from typing import NamedTuple


class Estimate(NamedTuple):
    """A mean over roll-outs."""

    mean: float
    error: float | None
    """Standard error of the mean; ``None`` if a single roll-out says nothing of it."""

    @classmethod
    def of(cls, values: Sequence[float]) -> Estimate:
        """Return the mean of roll-outs of one piece."""
        error = stdev(values) / math.sqrt(len(values)) if len(values) > 1 else None
        return cls(fmean(values), error)

    @classmethod
    def average(cls, estimates: Sequence[Estimate]) -> Estimate:
        """Return the mean over pieces, with the error that their roll-outs leave."""
        errors = [each.error for each in estimates if each.error is not None]
        error = math.hypot(*errors) / len(errors) if len(errors) == len(estimates) else None
        return cls(fmean(each.mean for each in estimates), error)

    def __str__(self) -> str:
        if self.error is None:
            return f"{self.mean:.2f}"
        digits = decimals(self.error)
        return f"{self.mean:.{digits}f} ± {self.error:.{digits}f}"


def decimals(error: float) -> int:
    """Return how many decimals of a score hold: 3 if its error is below half a hundredth."""
    return 3 if error < 0.005 else 2
