"""The grid of a MusicXML file that is written: ticks, measures and their meters."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score

DIVISIONS = 12_000
"""Ticks in a quarter note: thirds, fifths and 64ths are whole, and at 120 to the minute so is 1 ms.

Notation programs want no more than 16383.
"""

_WHOLE = 4 * DIVISIONS
_BEAT_TYPES = (4, 8, 16, 32, 64, 128)
_LINE_STEP = _WHOLE // _BEAT_TYPES[-1]
"""A bar line is at a whole 128th, so that each measure has a meter.

Measures that are longer or shorter than their meter are read by guessing what went wrong.
"""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Seconds in ticks.

    Attributes:
        tempo: Quarter notes per minute.
    """

    tempo: Fraction

    def span(self, event: Note | Pedal) -> tuple[int, int]:
        """Return the nearest ticks of an event, which lasts one at least."""
        start = self.tick(event.onset)
        return start, max(self.tick(event.offset), start + 1)

    def tick(self, time: float) -> int:
        """Return the nearest tick to a time in s."""
        return round(Fraction(time) * self.tempo * DIVISIONS / 60)


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A measure.

    Attributes:
        start: Its first tick.
        end: The first tick after it.
        meter: Beats and beat type; the measure is as long as they say.
        is_pickup: Whether it only leads to the first whole measure.
    """

    start: int
    end: int
    meter: tuple[int, int]
    is_pickup: bool = False


def measures_of(score: Score, grid: Grid) -> list[Measure]:
    """Return the measures of a score, by its bars, or of four quarter notes if it has none.

    A bar line is moved to the next 128th, if necessary; bars that have no length then are left out.
    """
    end_of_notes = max(grid.span(note)[1] for note in score.notes)
    last = max([end_of_notes, *(grid.span(pedal)[1] for pedal in score.pedals)])
    lines = {round(grid.tick(line) / _LINE_STEP) * _LINE_STEP for line in score.bars}
    lines = {line for line in lines if line < end_of_notes} or set(range(0, last, _WHOLE))
    starts = sorted({0, *lines})
    usual = starts[-1] - starts[-2] if len(starts) > 1 else _WHOLE
    rest = last - starts[-1]
    end = starts[-1] + (usual if usual >= rest else -(-rest // DIVISIONS) * DIVISIONS)
    return _with_meters([*starts, end], has_pickup=0 not in lines)


def _with_meters(lines: Sequence[int], has_pickup: bool) -> list[Measure]:
    meters = [_meter_of(end - start) for start, end in itertools.pairwise(lines)]
    if has_pickup and lines[1] - lines[0] < lines[2] - lines[1]:
        meters[0] = meters[1]
    return [
        Measure(start=start, end=end, meter=meter, is_pickup=has_pickup and start == 0)
        for (start, end), meter in zip(itertools.pairwise(lines), meters, strict=True)
    ]


def _meter_of(ticks: int) -> tuple[int, int]:
    """Return the meter of a measure, in the longest beats that it consists of."""
    beat_type = next(kind for kind in _BEAT_TYPES if ticks * kind % _WHOLE == 0)
    return ticks * beat_type // _WHOLE, beat_type
