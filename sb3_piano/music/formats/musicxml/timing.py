"""Where the notes of a MusicXML file stand in time: partitura's answer, in exact seconds."""

from __future__ import annotations

import bisect
import io
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

_QUARTERS_PER_MINUTE = 120
"""The tempo of a file until its first mark, as notation programs have it."""

_Line = Callable[[Fraction], Fraction]


@dataclass(frozen=True, kw_only=True)
class TimedPart:
    """A part with its repeats unfolded; all times in s.

    Attributes:
        notes: (id, start, end) of each note, sorted by start; a grace note ends where it starts.
        pedals: (down, up) of each press of the pedal.
        measures: When each measure begins, ascending.
    """

    notes: list[tuple[str, Fraction, Fraction]]
    pedals: list[tuple[Fraction, Fraction]]
    measures: list[Fraction]


def place_in_time(document: bytes) -> list[TimedPart]:
    """Let partitura read a document, and return its parts in order.

    Tempo marks of any part count for all.

    Raises:
        Exception: Whatever partitura raises at a damaged file.
    """
    from partitura import load_musicxml

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        parts = [_unfolded(part) for part in load_musicxml(io.BytesIO(document)).parts]
    quarters = [_quarters_of(part) for part in parts]
    seconds = _seconds_of(parts, quarters)
    return [_timed(part, of, seconds) for part, of in zip(parts, quarters, strict=True)]


def _unfolded(part: Any) -> Any:
    """Play repeats and endings, and jumps back (D.C., D.S.) without those repeats again."""
    from partitura import score

    jumps = (score.Repeat, score.DaCapo, score.DalSegno)
    if not any(True for kind in jumps for _ in part.iter_all(kind)):
        return part
    try:
        return score.unfold_part_maximal(part, update_ids=False, ignore_leaps=False)
    except (LookupError, RecursionError) as error:
        # partitura names the passages between repeats by the 52 letters.
        raise ValueError("its repeats are too many, or wrong") from error


def _quarters_of(part: Any) -> _Line:
    """Return the function from partitura's ticks to quarter notes."""
    return _line(
        (Fraction(int(tick)), 1 / Fraction(int(divisions)))
        for tick, divisions in part.quarter_durations()
    )


def _seconds_of(parts: list[Any], quarters: list[_Line]) -> _Line:
    """Return the function from quarter notes to seconds."""
    from partitura import score

    tempos = {Fraction(0): Fraction(_QUARTERS_PER_MINUTE)}
    for part, quarter in zip(parts, quarters, strict=True):
        for mark in part.iter_all(score.Tempo):
            if mark.bpm > 0:
                tempos[quarter(Fraction(mark.start.t))] = Fraction(str(mark.bpm))
    return _line((at, 60 / tempos[at]) for at in sorted(tempos))


def _line(corners: Iterable[tuple[Fraction, Fraction]]) -> _Line:
    """Return the function that is 0 at the first corner and has from each one on its slope."""
    starts: list[Fraction] = []
    values: list[Fraction] = []
    slopes: list[Fraction] = []
    for start, slope in corners:
        values.append(values[-1] + slopes[-1] * (start - starts[-1]) if starts else Fraction(0))
        starts.append(start)
        slopes.append(slope)

    def value(x: Fraction) -> Fraction:
        piece = max(bisect.bisect_right(starts, x) - 1, 0)
        return values[piece] + slopes[piece] * (x - starts[piece])

    return value


def _timed(part: Any, quarters: _Line, seconds: _Line) -> TimedPart:
    from partitura import score

    def at(point: Any) -> Fraction:
        return seconds(quarters(Fraction(point.t)))

    notes = [
        (note.id, at(note.start), at(note.end))
        for note in part.iter_all(score.Note)
        if note.id is not None
    ]
    pedals = [
        (at(pedal.start), at(pedal.end))
        for pedal in part.iter_all(score.SustainPedalDirection)
        if pedal.end is not None
    ]
    measures = [at(measure.start) for measure in part.iter_all(score.Measure)]
    return TimedPart(notes=notes, pedals=pedals, measures=measures)
