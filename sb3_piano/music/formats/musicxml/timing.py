"""In which order and when the music of a MusicXML file is played: tempo, repeats and leaps."""

from __future__ import annotations

import bisect
import functools
import itertools
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from sb3_piano.music.formats.musicxml.tempo_marks import Swings
from sb3_piano.music.text_file import read_whole

_QUARTERS_PER_MINUTE = Fraction(120)
"""The tempo of a file until its first mark, as notation programs have it."""

_SLOWEST, _FASTEST = Fraction(1), Fraction(9999)
"""Bounds of a tempo that is a multiple of that before."""

_FINEST = 2**64
"""Largest denominator of times that others are reckoned from."""

_MOST_TIMES = 20
"""How often what is repeated is played at most: damaged numbers would fill the memory."""


@dataclass
class _Ending:
    """An ending: the times at which it is played, and where it stops."""

    numbers: set[int]
    stop: Fraction | None = None


@dataclass
class Marks:
    """Marks of tempo and order in a file, in any part, by the quarter note at which they stand.

    Attributes:
        tempos: Quarter notes a minute from there on; with ``True`` as a multiple of those before.
        signs: Kinds, each with its name: forward and backward (repeats; how often they are played),
            dacapo, dalsegno, segno, tocoda, coda, fine.
        endings: The endings that start there.
        swings: Where notes are swung.
        end: Where the longest part ends.
    """

    tempos: dict[Fraction, tuple[Fraction, bool]] = field(default_factory=dict)
    signs: dict[Fraction, set[tuple[str, str]]] = field(default_factory=lambda: defaultdict(set))
    endings: dict[Fraction, _Ending] = field(default_factory=dict)
    swings: Swings = field(default_factory=Swings)
    end: Fraction = Fraction(0)
    _open: _Ending | None = None
    _sounding: set[Fraction] = field(default_factory=set)

    def add_tempo(
        self, at: Fraction, tempo: Fraction, *, printed: bool = False, relative: bool = False
    ) -> None:
        """Note a tempo; of several at one place the last that sounds counts, else the last."""
        if tempo > 0 and not (printed and at in self._sounding):
            self.tempos[at] = tempo, relative
            if not printed:
                self._sounding.add(at)

    def add(self, at: Fraction, kind: str, name: str = "") -> None:
        """Note a sign."""
        self.signs[at].add((kind, name))

    def begin_ending(self, at: Fraction, numbers: set[int]) -> None:
        """Note where an ending starts."""
        self._open = self.endings.setdefault(at, _Ending(numbers))

    def end_ending(self, at: Fraction) -> None:
        """Note where it stops; without that it is a measure long."""
        if self._open is not None:
            self._open.stop = at
        self._open = None

    def end_measure(self, at: Fraction) -> None:
        """Note where a measure ends."""
        self.end = max(self.end, at)
        if self._open is not None and self._open.stop is None:
            self._open.stop = at

    def times(self, at: Fraction) -> int:
        """Return how often is played what a repeat at a place ends, unless endings say more."""
        given = (name for sign, name in self.signs.get(at, ()) if sign == "backward")
        return max((min(read_whole(name) or 2, _MOST_TIMES) for name in given), default=2)

    def has(self, at: Fraction, kind: str) -> bool:
        """Return whether there is a sign of a kind."""
        return any(sign == kind for sign, _ in self.signs.get(at, ()))


@dataclass
class Timeline:
    """Times at which each moment of the written music is played, once or several times.

    Attributes:
        seconds: The function from quarter notes to seconds, of the written music.
        starts: When each stretch of it begins that is played in one go, in s.
        later: For each stretch by how much later it is played than written, each time, in s.
    """

    seconds: Callable[[Fraction], Fraction]
    starts: list[Fraction]
    later: list[list[Fraction]]

    def played(
        self, start: Fraction, end: Fraction, *, closes: bool = False
    ) -> Iterator[tuple[Fraction, Fraction]]:
        """Yield when an event is played, in s, by its start and end in quarter notes.

        What ``closes`` a measure, where the next one begins, is played with the former.
        """
        first, last = self.seconds(start), self.seconds(end)
        find = bisect.bisect_left if closes else bisect.bisect_right
        for shift in self.later[max(find(self.starts, first) - 1, 0)]:
            yield first + shift, last + shift


def timeline(marks: Marks) -> Timeline:
    """Lay out the music.

    On jumps back the tempo is that of the place, as players have it.
    """
    corners = sorted({Fraction(0), *marks.tempos})
    tempos, times = [_QUARTERS_PER_MINUTE], [Fraction(0)]
    for start, stop in itertools.pairwise([*corners, marks.end]):
        tempo, relative = marks.tempos.get(start, (tempos[-1], False))
        if relative:
            tempo = min(max(_short(tempo * tempos[-1]), _SLOWEST), _FASTEST)
        tempos.append(tempo)
        times.append(_short(times[-1] + (stop - start) * 60 / tempos[-1]))

    @functools.cache
    def seconds(at: Fraction) -> Fraction:
        piece = bisect.bisect_right(corners, at) - 1
        return times[piece] + (at - corners[piece]) * 60 / tempos[piece + 1]

    spans, order = _played_order(marks)
    starts = [seconds(start) for start, _ in spans]
    later: list[list[Fraction]] = [[] for _ in spans]
    now = shift = Fraction(0)
    for former, index in itertools.pairwise([-1, *order]):
        if index != former + 1:
            shift = _short(now - starts[index])
        later[index].append(shift)
        now = seconds(spans[index][1]) + shift
    return Timeline(seconds=seconds, starts=starts, later=later)


def _short(number: Fraction) -> Fraction:
    """Return a number, rounded where sums of many tempos have made it one of a hundred digits."""
    return number if number.denominator < _FINEST else Fraction(round(number * _FINEST), _FINEST)


def _played_order(marks: Marks) -> tuple[list[tuple[Fraction, Fraction]], list[int]]:
    """Return the stretches of the written music, and their indices in the order of playing.

    A repeat is played twice, or as often as it says (up to 20 times) or has endings. After D.C. or
    D.S. repeats are played no more, and of several endings the last.
    """
    stops = {ending.stop for ending in marks.endings.values() if ending.stop is not None}
    places = sorted({Fraction(0), marks.end, *marks.signs, *marks.endings, *stops})
    spans = list(itertools.pairwise(places)) or [(Fraction(0), marks.end)]
    endings = _endings_of(spans, marks)
    order: list[int] = []
    here = first = 0
    time, leapt = 1, False
    while here < len(spans):
        start, stop = spans[here]
        numbers, all_numbers = endings[here]
        turn = max(all_numbers, default=0) if leapt else time
        is_played = not numbers or turn in numbers
        if is_played:
            order.append(here)
            if marks.has(start, "forward") and here > first:
                first, time = here, 1
            if (
                not leapt
                and marks.has(stop, "backward")
                and time < max(marks.times(stop), len(all_numbers))
            ):
                here, time = first, time + 1
                continue
            if leapt and marks.has(stop, "fine"):
                break
            target = _leap(marks, spans, here, leapt)
            if target is not None:
                here, leapt = target, True
                continue
        is_last_ending = bool(numbers) and not any(ending for ending, _ in endings[here + 1 :][:1])
        if is_last_ending or (is_played and marks.has(stop, "backward")):
            first, time = here + 1, 1
        here += 1
    return spans, order


def _endings_of(
    spans: Sequence[tuple[Fraction, Fraction]], marks: Marks
) -> list[tuple[set[int], set[int]]]:
    """Return for each stretch the numbers of its ending, and those of all endings beside it."""
    numbers: list[set[int]] = []
    for start, _ in spans:
        inside = [
            ending.numbers
            for begin, ending in marks.endings.items()
            if ending.stop is not None and begin <= start < ending.stop
        ]
        numbers.append(inside[-1] if inside else set())
    found: list[tuple[set[int], set[int]]] = []
    for _, group in itertools.groupby(numbers, key=bool):
        members = list(group)
        found += [(one, set().union(*members)) for one in members]
    return found


def _leap(
    marks: Marks, spans: Sequence[tuple[Fraction, Fraction]], here: int, leapt: bool
) -> int | None:
    """Return the stretch to which a sign at the end of one leads: back once, then to a coda."""
    stop = spans[here][1]
    if not leapt and marks.has(stop, "dacapo"):
        return 0
    kind, to = ("tocoda", "coda") if leapt else ("dalsegno", "segno")
    names = {name for sign, name in marks.signs.get(stop, ()) if sign == kind}
    if not names:
        return None
    for index, (start, _) in enumerate(spans):
        is_allowed = index > here if leapt else index <= here
        if is_allowed and any((to, name) in marks.signs.get(start, ()) for name in names):
            return index
    return None
