"""Tell what kinds of passages the notes of a fingered piece belong to.

The kinds are those by which the curriculum paper (Farah, Lin and Walrath, section 6.4) compares
fingerings. It does not define them; the definitions here are ours.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Iterator, Sequence
from typing import Literal

from sb3_piano.music import Note, Score
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.hands import HANDS, finger_number

Kind = Literal["scale", "arpeggio", "octave", "thumb-under", "hands crossed", "other"]

KINDS: tuple[Kind, ...] = ("scale", "arpeggio", "octave", "thumb-under", "hands crossed", "other")

_OCTAVE = 12
_STEPS = range(1, 3)
"""Semitones from a note of a scale to the next."""
_LEAPS = range(3, 6)
"""Semitones from a note of an arpeggio to the next."""
_FEWEST = 4
"""Notes of the shortest scale or arpeggio."""
_TOGETHER = 0.03
"""Onsets at most this far apart are struck together, s."""


def passages(score: Score) -> list[frozenset[Kind]]:
    """Return the kinds of passages that each note belongs to, at least one.

    - scale, arpeggio: at least four single notes of a hand in one direction, 1 to 2 or 3 to 5
      semitones apart.
    - octave: struck together with the note an octave above or below by the same hand.
    - thumb-under: single notes of a hand between which the thumb goes under another finger, or the
      finger over the thumb.
    - hands crossed: the left hand's note is above a note that the right hand holds meanwhile, or
      the right hand's below one of the left hand's.

    Args:
        score: A score with fingers. A note of no hand is "other"; thumbs need fingers.
    """
    kinds: list[set[Kind]] = [set() for _ in score.notes]
    for hand in HANDS:
        own = [index for index, note in enumerate(score.notes) if note.hand == hand]
        outward = 1 if hand == "right" else -1
        line: list[int] = []
        for chord in _chords(score.notes, own):
            for low, high in itertools.combinations(chord, 2):
                if abs(score.notes[high].pitch - score.notes[low].pitch) == _OCTAVE:
                    kinds[low].add("octave")
                    kinds[high].add("octave")
            if len(chord) == 1:
                line += chord
            else:
                _mark_line(score.notes, line, outward, kinds)
                line = []
        _mark_line(score.notes, line, outward, kinds)
    for left, right in _crossed(score.notes):
        kinds[left].add("hands crossed")
        kinds[right].add("hands crossed")
    return [frozenset(found or {"other"}) for found in kinds]


def _chords(notes: Sequence[Note], indices: list[int]) -> Iterator[list[int]]:
    """Yield the notes that are struck together; the score has them by onset."""
    chord: list[int] = []
    for index in indices:
        if chord and notes[index].onset - notes[chord[0]].onset > _TOGETHER:
            yield chord
            chord = []
        chord.append(index)
    if chord:
        yield chord


def _mark_line(
    notes: Sequence[Note], line: list[int], outward: int, kinds: list[set[Kind]]
) -> None:
    """Mark scales, arpeggios and thumbs among single notes that follow each other."""
    intervals = [notes[b].pitch - notes[a].pitch for a, b in itertools.pairwise(line)]
    names: tuple[tuple[Kind, range], ...] = (("scale", _STEPS), ("arpeggio", _LEAPS))
    for (name, sizes), sign in itertools.product(names, (1, -1)):
        start = 0
        for end in range(len(line)):
            if end == len(intervals) or intervals[end] * sign not in sizes:
                if end + 1 - start >= _FEWEST:
                    for index in line[start : end + 1]:
                        kinds[index].add(name)
                start = end + 1
    for (a, b), interval in zip(itertools.pairwise(line), intervals, strict=True):
        if UNKNOWN_FINGER in (notes[a].finger, notes[b].finger):
            continue
        first, second = finger_number(notes[a].finger), finger_number(notes[b].finger)
        # From the thumb to the little finger pitch rises in the right hand and falls in the left.
        if interval * outward * (second - first) < 0 and 1 in (first, second):
            kinds[a].add("thumb-under")
            kinds[b].add("thumb-under")


def _crossed(notes: Sequence[Note]) -> Iterator[tuple[int, int]]:
    """Yield notes of the left and the right hand that are held together with the left one above."""
    rights = [index for index, note in enumerate(notes) if note.hand == "right"]
    onsets = [notes[index].onset for index in rights]
    longest = max((notes[index].duration for index in rights), default=0.0)
    for left, note in enumerate(notes):
        if note.hand != "left":
            continue
        begin = bisect.bisect_left(onsets, note.onset - longest)
        end = bisect.bisect_left(onsets, note.offset)
        for right in rights[begin:end]:
            if notes[right].offset > note.onset and note.pitch > notes[right].pitch:
                yield left, right
