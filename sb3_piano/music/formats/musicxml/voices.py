"""Which voice of a MusicXML file a note is in, and what the voice leaves empty."""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterator, Sequence

from sb3_piano.music.formats.musicxml.measures import Grid, Measure
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

_MIDDLE_C = 60

_VOICES_OF_A_STAFF = 4
"""As many as notation programs have; more are written, but only if the notes need them."""


def staff_of(note: Note) -> int:
    """Return 1 for the right hand and 2 for the left; an unknown hand goes by the pitch."""
    hand = note.hand or ("right" if note.pitch >= _MIDDLE_C else "left")
    return HANDS.index(hand) + 1


def voices_of(score: Score, grid: Grid) -> tuple[tuple[int, int], list[int]]:
    """Return the first voice of each staff, and for each note a voice of its own or its chord."""
    last: dict[int, list[tuple[int, int]]] = {1: [], 2: []}
    chosen = []
    for note in score.notes:
        staff, span = staff_of(note), grid.span(note)
        free = (i for i, other in enumerate(last[staff]) if other[1] <= span[0])
        joined = (i for i, other in enumerate(last[staff]) if other == span)
        index = next(itertools.chain(joined, free), len(last[staff]))
        last[staff][index : index + 1] = [span]
        chosen.append((staff, index + 1))
    upper = max(len(last[1]), _VOICES_OF_A_STAFF)
    return (1, upper + 1), [index + upper * (staff - 1) for staff, index in chosen]


def pieces_of(start: int, end: int, lines: Sequence[int]) -> list[tuple[int, int]]:
    """Return a span of ticks, cut at the bar lines within it."""
    inside = lines[bisect.bisect_right(lines, start) : bisect.bisect_left(lines, end)]
    cuts = [start, *inside, end]
    return list(itertools.pairwise(cuts))


def gaps_of(
    spans: Sequence[tuple[int, int]], measures: Sequence[Measure], to_the_end: bool
) -> Iterator[tuple[int, int]]:
    """Yield what a voice leaves empty, measure by measure.

    Args:
        spans: The notes of the voice, none of which crosses a bar line.
        measures: All measures.
        to_the_end: Whether each measure is to be filled; else what follows its last note is not.
    """
    spans = sorted(set(spans))
    starts = [start for start, _ in spans]
    for measure in measures:
        here = measure.start
        first, last = (bisect.bisect_left(starts, tick) for tick in (here, measure.end))
        for start, end in spans[first:last]:
            if start > here:
                yield here, start
            here = end
        if to_the_end and here < measure.end:
            yield here, measure.end
