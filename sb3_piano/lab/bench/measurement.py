"""Measurements in turn, round after round, and the medians of their rates and ratios."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import track


@dataclass(frozen=True)
class Sample:
    """Steps or updates done by one run of a measurement, and the seconds they took."""

    count: int
    seconds: float
    parts: Mapping[str, float] = field(default_factory=dict)
    """Seconds thereof by the kind of work, such as ``in the learner``."""
    processor: float | None = None
    """The processor's seconds, on which other programs tell less; ``None`` if not measured."""

    @property
    def rate(self) -> float:
        """Steps or updates per second."""
        return self.count / self.seconds

    @property
    def processor_rate(self) -> float:
        """Steps or updates per second of the processor's time, if measured, else of time."""
        return self.count / (self.processor or self.seconds)


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A workload whose rate is measured; its names are unique."""

    name: str
    unit: str
    run: Callable[[], Sample]
    """Does the work once; preparations stay outside of the sample's time."""
    ratios: dict[str, tuple[str, str]] = field(default_factory=dict)
    """Ratios to report: label to the names of the two measurements whose rates are divided."""


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
    """The same per second of the processor's time, of all threads; ``None`` if not measured."""
    processor_ratios: Mapping[str, float] = field(default_factory=dict)
    """Its ratios."""


def measure(
    part: str,
    measurements: Sequence[Measurement],
    rounds: int,
    rows: list[Row],
    progress: bool = False,
) -> None:
    """Run measurements in turn and add a row for each, of the complete rounds if interrupted.

    Every other round runs in reverse order, so that none always follows the same neighbour. One
    round to warm up comes before the ``rounds`` that count.
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
    """Row of a measurement, from the samples of all in the same rounds.

    A disturbance that lasts longer than a round changes both sides of a ratio alike: the median of
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
