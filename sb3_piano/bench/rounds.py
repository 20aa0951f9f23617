"""Measuring side by side: everyone plays once a round, so that a busy machine is busy for all."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

Tick = Callable[[str, int, int], None]
"""Is called with what is measured, how many laps of it are over, and how many there will be."""


@dataclass(frozen=True, kw_only=True)
class Lap:
    """What one contestant did in one round."""

    steps: int
    """How many steps, or updates, it did."""
    seconds: float
    """How long they took, s."""
    within: Mapping[str, float] = field(default_factory=dict)
    """How long some kinds of work took thereof, s."""

    @property
    def rate(self) -> float:
        """Steps per second."""
        return self.steps / self.seconds


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A ratio that a contestant is reported with."""

    label: str
    """What the ratio is called."""
    base: str
    """Name of the contestant that is compared with."""
    of_times: bool = False
    """Compare times per step, where less is better, in place of steps per second."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """Something whose speed is measured."""

    name: str
    """Its name, unlike all others."""
    unit: str
    """What its rate counts, such as ``updates/s``."""
    play: Callable[[], Lap]
    """Plays one lap; preparations that are not to be measured happen outside the lap's clock."""
    comparisons: tuple[Comparison, ...] = ()
    """The ratios it is reported with."""


class Race:
    """Lets contestants play in turn, one lap each a round, never two at a time.

    Args:
        part: What is measured.
        contestants: Who takes part.
    """

    def __init__(self, part: str, contestants: Sequence[Contestant]) -> None:
        self.part = part
        self.contestants = tuple(contestants)
        self.rounds: list[dict[str, Lap]] = []
        """The rounds that are over: each contestant's lap by its name."""

    def run(self, rounds: int, tick: Tick | None = None) -> None:
        """Play one round to warm up, which does not count, and then the given number of rounds.

        Every other round goes backwards, so that nobody always plays after the same neighbour.
        """
        laps, done = (rounds + 1) * len(self.contestants), 0
        for number in range(rounds + 1):
            played: dict[str, Lap] = {}
            for contestant in self.contestants[:: -1 if number % 2 else 1]:
                played[contestant.name] = contestant.play()
                done += 1
                if tick is not None:
                    tick(self.part, done, laps)
            if number > 0:
                self.rounds.append(played)
