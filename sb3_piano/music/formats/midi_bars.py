"""Bar lines as the time signatures of a MIDI file.

A MIDI file has no bar lines: its bars follow from its time signatures, each of which begins one.
Where bars are as long as some meter says, the meter is written once. A bar of another length gets
a longer meter, which the next time signature cuts short.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

_DENOMINATORS = (4, 8, 16, 32, 64)
_LONG_DENOMINATORS = (4, 2, 1)
_MOST_BEATS = 255
"""The numerator of a time signature is one byte."""

Meter = tuple[int, int]
"""Numerator and denominator of a time signature."""


def meters_of_bars(
    lines: Sequence[int], end: int, ticks_per_beat: int
) -> Iterator[tuple[int, Meter]]:
    """Yield the time signatures, with their ticks, whose bars begin at `lines`.

    Args:
        lines: Ticks from 0 with which the bars begin, strictly ascending. The piece begins a bar,
            too: MIDI has no bar that is under way at the start.
        end: Tick with which the last bar ends, later than the last line.
        ticks_per_beat: Ticks in a quarter note.
    """
    lines = [0, *(line for line in lines if 0 < line < end), end]
    running: Meter | None = None
    for start, stop in itertools.pairwise(lines):
        meter, is_exact = _meter_of(stop - start, ticks_per_beat)
        is_last = stop == end
        if is_last and running and _ticks_of(running, ticks_per_beat) >= stop - start:
            return
        if meter != running:
            yield start, meter
        running = meter if is_exact else None


def _meter_of(ticks: int, ticks_per_beat: int) -> tuple[Meter, bool]:
    """Return a meter as long as a bar, or the next longer one, and whether it is as long."""
    for denominator in _DENOMINATORS:
        beats, rest = divmod(ticks * denominator, 4 * ticks_per_beat)
        if rest == 0 and beats <= _MOST_BEATS:
            return (beats, denominator), True
    for denominator in _LONG_DENOMINATORS:
        beats = -(-ticks * denominator // (4 * ticks_per_beat))
        if beats <= _MOST_BEATS:
            break
    return (min(beats, _MOST_BEATS), denominator), False


def _ticks_of(meter: Meter, ticks_per_beat: int) -> float:
    return 4 * ticks_per_beat * meter[0] / meter[1]
