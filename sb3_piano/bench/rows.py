"""From laps to the rows of the table: medians, and ratios of what ran side by side."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sb3_piano.bench.rounds import Comparison, Contestant, Lap


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measured quantity with its unit and its ratios to others."""

    part: str
    """What was measured, such as ``simulation``."""
    name: str
    """What it was measured of."""
    value: float
    """The median over the rounds."""
    unit: str
    """Unit of ``value``."""
    ratios: Mapping[str, float]
    """Ratios by what they are called; each the median of the rounds' ratios."""
    by_round: tuple[float, ...] = ()
    """The value in each round."""


def speed_rows(
    part: str, contestants: Sequence[Contestant], rounds: Sequence[Mapping[str, Lap]]
) -> tuple[Row, ...]:
    """Return a row for each contestant; none if no round was played to its end."""
    if not rounds:
        return ()
    return tuple(
        Row(
            part=part,
            name=contestant.name,
            value=statistics.median(lap[contestant.name].rate for lap in rounds),
            unit=contestant.unit,
            ratios={
                **{
                    c.label: median_ratio(contestant.name, c, rounds)
                    for c in contestant.comparisons
                },
                **median_shares([laps[contestant.name] for laps in rounds]),
            },
            by_round=tuple(laps[contestant.name].rate for laps in rounds),
        )
        for contestant in contestants
    )


def median_ratio(name: str, comparison: Comparison, rounds: Sequence[Mapping[str, Lap]]) -> float:
    """Return the median over the rounds of the ratio between a contestant and its base.

    A disturbance that lasts longer than a round changes both, and so hardly their ratio.
    """
    ratios = (laps[name].rate / laps[comparison.base].rate for laps in rounds)
    return statistics.median(1 / ratio if comparison.of_times else ratio for ratio in ratios)


def median_shares(laps: Sequence[Lap]) -> dict[str, float]:
    """Return the shares of time in [0, 1] that kinds of work took, and all else; empty if none.

    Args:
        laps: Of one contestant, all with the same kinds of work.
    """
    if not laps[0].within:
        return {}
    shares = {
        f"of the time in the {kind}": statistics.median(
            lap.within[kind] / lap.seconds for lap in laps
        )
        for kind in laps[0].within
    }
    rest = statistics.median(1 - sum(lap.within.values()) / lap.seconds for lap in laps)
    return {**shares, "of the time elsewhere": rest}
