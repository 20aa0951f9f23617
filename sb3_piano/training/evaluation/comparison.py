"""The result of a comparison."""

from __future__ import annotations

import dataclasses
import math
import statistics
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sb3_piano.training.csv_files import write_csv
from sb3_piano.training.statistics import SignedRankTest, Summary

# Two means of equal values may differ in their last digits; this is no difference.
_EQUAL = 1e-12


@dataclass(frozen=True, kw_only=True)
class Pair:
    """What A and B reach at the same task, the mean over all their episodes of it."""

    piece: str
    """What was played."""
    seed: int | None
    """The seed of evaluation or training that makes the pair, if one does."""
    a: float
    """What A reaches."""
    b: float
    """What B reaches."""

    @property
    def difference(self) -> float:
        """How much more B reaches than A."""
        return 0.0 if math.isclose(self.a, self.b, rel_tol=_EQUAL) else self.b - self.a


@dataclass(frozen=True, kw_only=True)
class MetricComparison:
    """A metric of A and B over all pairs."""

    metric: str
    """Name of the metric."""
    pairs: tuple[Pair, ...]
    """The pairs, by piece and seed."""
    difference: Summary
    """Mean of the differences B - A, with its interval."""
    test: SignedRankTest
    """Whether the differences lean to one side."""

    @property
    def mean_a(self) -> float:
        """Mean of A over the pairs."""
        return statistics.fmean(pair.a for pair in self.pairs)

    @property
    def mean_b(self) -> float:
        """Mean of B over the pairs."""
        return statistics.fmean(pair.b for pair in self.pairs)

    @property
    def n_a_below_b(self) -> int:
        """In how many pairs A is below B."""
        return sum(pair.difference > 0 for pair in self.pairs)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What :func:`~sb3_piano.training.compare` found."""

    a: str
    """Where A was read from."""
    b: str
    """Where B was read from."""
    by: str
    """What makes a pair, see :func:`~sb3_piano.training.compare`."""
    metrics: tuple[MetricComparison, ...]
    """The comparison of each metric."""
    physics_a: tuple[str, ...]
    """Names of the physics profiles on which A was played; one, if all is well."""
    physics_b: tuple[str, ...]
    """Those on which B was played; expected to be the same."""
    only_in_a: tuple[str, ...]
    """Pieces, or seeds of pieces, that only A has; they are left out."""
    only_in_b: tuple[str, ...]
    """Those that only B has."""

    def to_json(self) -> dict[str, Any]:
        """Return all of it in JSON's types."""
        return {
            "a": self.a,
            "b": self.b,
            "by": self.by,
            "physics_a": list(self.physics_a),
            "physics_b": list(self.physics_b),
            "only_in_a": list(self.only_in_a),
            "only_in_b": list(self.only_in_b),
            "metrics": {m.metric: _metric_json(m) for m in self.metrics},
        }

    def write_csv(self, path: Path) -> None:
        """Write a row for each metric and pair."""
        rows = [{"metric": m.metric, **_pair_json(pair)} for m in self.metrics for pair in m.pairs]
        write_csv(path, ("metric", "piece", "seed", "a", "b", "difference"), rows)


def _pair_json(pair: Pair) -> dict[str, Any]:
    return {**dataclasses.asdict(pair), "difference": pair.difference}


def _metric_json(comparison: MetricComparison) -> dict[str, Any]:
    difference, test = comparison.difference, comparison.test
    return {
        "pairs": [_pair_json(pair) for pair in comparison.pairs],
        "mean_a": comparison.mean_a,
        "mean_b": comparison.mean_b,
        "mean_difference": difference.mean,
        "interval": None if difference.interval is None else list(difference.interval),
        "no_interval": difference.no_interval,
        "n_a_below_b": comparison.n_a_below_b,
        "n_pairs_that_differ": test.n,
        "wilcoxon_p": test.p,
        "least_p": test.least_p,
        "no_test": test.no_test,
    }
