"""Interleaved measurements in rounds, and medians of their rates and ratios."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import track


@dataclass(frozen=True)
class Sample:
    """Number and duration of the steps or updates of one run of a measurement."""

    count: int
    seconds: float
    parts: Mapping[str, float] = field(default_factory=dict)
    """Seconds by kind of work, such as ``in the learner``."""
    processor: float | None = None
    """CPU seconds, less affected by other programs; ``None`` if not measured."""

    @property
    def rate(self) -> float:
        """Steps or updates per second."""
        return self.count / self.seconds

    @property
    def processor_rate(self) -> float:
        """Steps or updates per CPU second, if measured, else per second."""
        return self.count / (self.processor or self.seconds)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A workload whose rate is measured; its names are unique."""

    name: str
    unit: str
    run: Callable[[], Sample]
    """Function that does the work once; the sample's time excludes preparation."""
    ratios: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Ratios to report: names of the two measurements of each ratio, by label."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measured quantity and its ratios to others, medians over the rounds."""

    part: str
    """Part of the benchmark, such as ``simulation``."""
    name: str
    value: float
    unit: str
    ratios: Mapping[str, float]
    by_round: Sequence[float] = ()
    """Value in each round."""
    processor: float | None = None
    """Value per CPU second of all threads; ``None`` if not measured."""
    processor_ratios: Mapping[str, float] = field(default_factory=dict)
    """Ratios of ``processor``."""


def measure(
    part: str,
    measurements: Sequence[Measurement],
    rounds: int,
    rows: list[Row],
    progress: bool = False,
) -> None:
    """Run measurements in rounds and add a row for each, from the complete rounds if interrupted.

    Every other round runs in reverse order, so that no measurement always follows the same one. A
    warm-up round precedes the ``rounds``.
    """
    samples: dict[str, list[Sample]] = {measurement.name: [] for measurement in measurements}
    turns = [m for number in range(rounds + 1) for m in measurements[:: -1 if number % 2 else 1]]
    try:
        for turn in track(turns, part, console=Console(stderr=True), disable=not progress):
            samples[turn.name].append(turn.run())
    finally:
        complete = min(len(of_one) for of_one in samples.values())
        if complete > 1:
            counted = {name: of_one[1:complete] for name, of_one in samples.items()}
            rows += [_row(part, measurement, counted) for measurement in measurements]


def _row(part: str, measurement: Measurement, samples: Mapping[str, Sequence[Sample]]) -> Row:
    """Return the row of a measurement, from the samples of all in the same rounds.

    A disturbance longer than a round affects both sides of a ratio alike: the median of
    ratios is steadier than the ratio of medians.
    """
    own = samples[measurement.name]
    rates = [sample.rate for sample in own]
    ratios, processor_ratios = {}, {}
    for label, (over, under) in measurement.ratios.items():
        pairs = [*zip(samples[over], samples[under], strict=True)]
        ratios[label] = statistics.median(a.rate / b.rate for a, b in pairs)
        processor_ratios[label] = statistics.median(
            a.processor_rate / b.processor_rate for a, b in pairs
        )
    for kind in own[0].parts:
        shares = (sample.parts[kind] / sample.seconds for sample in own)
        ratios[f"of the time {kind}"] = statistics.median(shares)
    name, value, unit = measurement.name, statistics.median(rates), measurement.unit
    if own[0].processor is None:
        return Row(part=part, name=name, value=value, unit=unit, ratios=ratios, by_round=rates)
    return Row(
        part=part,
        name=name,
        value=value,
        unit=unit,
        ratios=ratios,
        by_round=rates,
        processor=statistics.median(sample.processor_rate for sample in own),
        processor_ratios=processor_ratios,
    )
