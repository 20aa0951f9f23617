"""Computes from measured costs what large experiments take on 1, 10 and 100 machines.

    python docs/building/scale.py

Prints the table of docs/at_scale.md, in Markdown.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

MACHINES = (1, 10, 100)
CORES = (2, 16)
"""Cores of a machine: as measured, and of a usual one."""

EXCERPTS_PER_S = 1.1
"""Excerpts of 12 s that one core plays and labels, 1/s (docs/sight_reader_training.md)."""
IMITATION_PER_EXCERPT = 7 * 60 * 2 / 500
"""Core seconds of the first two rounds, for 500 excerpts (docs/sight_reader_training.md)."""
PPO = 52 * 60 * 2
"""Core seconds of 2.8 million steps of PPO, on two cores (docs/sight_reader_training.md)."""
SAC_STEPS_PER_S = 240_000 / (23 * 60)
"""Control steps that `--config fast` learns from on one core, 1/s (docs/learning.md)."""
DEFAULT_SAC_STEPS_PER_S = 38.0
"""The same of the default preset of SAC (docs/performance.md)."""

_HOUR, _DAY = 3600.0, 86400.0


class Experiment(NamedTuple):
    """Jobs that do not depend on each other, and what comes after all of them."""

    name: str
    jobs: int
    job: float
    """Time of a job, s of one core."""
    after: float = 0.0
    """Time that no further machine shortens, s of one core."""
    after_cores: int = 1
    """Most cores that this can use."""

    def seconds(self, machines: int, cores: int) -> float:
        """Return the time on so many machines with so many cores each, s.

        Jobs are of one length here: they run in waves of as many as there are cores.
        """
        waves = math.ceil(self.jobs / (machines * cores))
        return waves * self.job + self.after / min(cores, self.after_cores)


EXPERIMENTS: Sequence[Experiment] = (
    Experiment("a million trajectories of 12 s, planned", 1_000_000, 1 / EXCERPTS_PER_S),
    Experiment(
        "sight-reader: 10,000 pieces, an excerpt of 12 s each",
        10_000,
        1 / EXCERPTS_PER_S,
        10_000 * (IMITATION_PER_EXCERPT - 1 / EXCERPTS_PER_S) + PPO,
        2,
    ),
    Experiment("150 pieces, 5 seeds, 1M steps, SAC fast", 750, 1e6 / SAC_STEPS_PER_S),
    Experiment("150 pieces, 5 seeds, 1M steps, SAC default", 750, 1e6 / DEFAULT_SAC_STEPS_PER_S),
)


def in_words(seconds: float) -> str:
    """Return a time in minutes, hours or days, with two digits that count."""
    for unit, length in (("days", _DAY), ("h", _HOUR)):
        if seconds >= 2 * length:
            number = seconds / length
            return f"{number:.0f} {unit}" if number >= 10 else f"{number:.1f} {unit}"
    return f"{seconds / 60:.0f} min"


def table() -> str:
    """Return times of all experiments as Markdown."""
    heads = [f"{n} x {cores}" for cores in CORES for n in MACHINES]
    lines = [
        f"| experiment | core hours | {' | '.join(heads)} |",
        f"|---|---:|{'---:|' * len(heads)}",
    ]
    for each in EXPERIMENTS:
        total = (each.jobs * each.job + each.after) / _HOUR
        times = [in_words(each.seconds(n, cores)) for cores in CORES for n in MACHINES]
        lines.append(f"| {each.name} | {total:,.0f} | {' | '.join(times)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
