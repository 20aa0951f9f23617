"""Compute the times at which the music of a MusicXML file is played."""

from __future__ import annotations

import bisect
import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

from sb3_piano.music.formats.musicxml.order import playing_order
from sb3_piano.music.formats.musicxml.signs import Signs
from sb3_piano.music.formats.musicxml.tempo_marks import Swings

_QUARTERS_PER_MINUTE = Fraction(120)
"""The tempo of a file before its first mark, as in notation programs."""

_SLOWEST, _FASTEST = Fraction(1), Fraction(9999)
"""Limits of a tempo that is a multiple of the one before."""

_FINEST = 2**64
"""Largest denominator of times used in further sums."""


@dataclass
class Marks:
    """Marks of tempo and order in any part of a file, by their quarter note.

    Attributes:
        tempos: Quarter notes a minute from there on; with ``True``, a multiple of the last tempo.
        signs: Repeats and jumps.
        swings: Places of swing.
    """

    tempos: dict[Fraction, tuple[Fraction, bool]] = field(default_factory=dict)
    signs: Signs = field(default_factory=Signs)
    swings: Swings = field(default_factory=Swings)
    _sounding: set[Fraction] = field(default_factory=set)

    def add_tempo(
        self, at: Fraction, tempo: Fraction, *, printed: bool = False, relative: bool = False
    ) -> None:
        """Add a tempo; at one place the last declared one counts, else the last printed one."""
        if tempo > 0 and not (printed and at in self._sounding):
            self.tempos[at] = tempo, relative
            if not printed:
                self._sounding.add(at)


@dataclass
class Timeline:
    """Times at which each moment of the written music is played, once or several times.

    Attributes:
        seconds: Function from quarter notes to seconds, for the written music.
        starts: Start of each section that is played without a jump, in s.
        later: For each section, the delay of each of its turns relative to the written time, in s.
        unplayed: Numbers of bars that are never played, as no sign leads there.
        aimless: Number of a bar that ends in a jump without a target, if there is one.
    """

    seconds: Callable[[Fraction], Fraction]
    starts: list[Fraction]
    later: list[list[Fraction]]
    unplayed: list[str]
    aimless: list[str]

    def played(
        self, start: Fraction, end: Fraction, *, closes: bool = False
    ) -> Iterator[tuple[Fraction, Fraction]]:
        """Yield the times of an event, in s, from its start and end in quarter notes.

        An event that ``closes`` a measure at the next one's start is played with the former.
        """
        first, last = self.seconds(start), self.seconds(end)
        find = bisect.bisect_left if closes else bisect.bisect_right
        for shift in self.later[max(find(self.starts, first) - 1, 0)]:
            yield first + shift, last + shift


def timeline(marks: Marks) -> Timeline:
    """Compute the times of all music.

    After a jump back, the tempo is the written one of the place.
    """
    corners = sorted({Fraction(0), *marks.tempos})
    tempos, times = [_QUARTERS_PER_MINUTE], [Fraction(0)]
    for start, stop in itertools.pairwise([*corners, marks.signs.end]):
        tempo, relative = marks.tempos.get(start, (tempos[-1], False))
        if relative:
            tempo = min(max(_short(tempo * tempos[-1]), _SLOWEST), _FASTEST)
        tempos.append(tempo)
        times.append(_short(times[-1] + (stop - start) * 60 / tempos[-1]))

    @functools.cache
    def seconds(at: Fraction) -> Fraction:
        piece = bisect.bisect_right(corners, at) - 1
        return times[piece] + (at - corners[piece]) * 60 / tempos[piece + 1]

    order = playing_order(marks.signs)
    starts = [seconds(start) for start, _ in order.spans]
    later: list[list[Fraction]] = [[] for _ in starts]
    now = shift = Fraction(0)
    for former, index in itertools.pairwise([-1, *order.played]):
        if index != former + 1:
            shift = _short(now - starts[index])
        later[index].append(shift)
        now = seconds(order.spans[index][1]) + shift
    return Timeline(seconds, starts, later, order.unplayed, order.aimless)


def _short(number: Fraction) -> Fraction:
    """Round a number whose denominator has grown too large."""
    return number if number.denominator < _FINEST else Fraction(round(number * _FINEST), _FINEST)
