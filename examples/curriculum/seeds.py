"""Figures over seeds, as the tables of this folder have them."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import fmean


def over_seeds(values: Sequence[float]) -> str:
    """Return the mean over the seeds, and the least and the greatest of them; a dash for none."""
    if not values:
        return "-"
    digits = 0 if max(values) > 100 else 1 if max(values) > 2 else 3
    mean = f"{fmean(values):.{digits}f}"
    if len(values) == 1:
        return mean
    return f"{mean} [{min(values):.{digits}f}, {max(values):.{digits}f}]"
