"""What about a score makes it hard, exactly, from its notes' times.

A key counts as pressed from a note's onset to its offset; what the pedal holds does not. Presses
that overlap by less than 1 ms follow each other: times are rounded, and a melody in legato has one
note at a time.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from operator import attrgetter

from sb3_piano.music.fingering import assign_hands
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

SAME_TIME = 1e-3
"""Overlaps shorter than this are none, in s."""

SAME_CHORD = 0.03
"""A hand's onsets this close to a chord's first one belong to it, in s; as in E. Nakamura et al.,
"Statistical learning and estimation of piano fingering", 2020."""


@dataclass(frozen=True, kw_only=True)
class Features:
    """What about a score makes it hard.

    The names are those of the paper that :func:`~sb3_piano.music.difficulty.rank` follows.
    """

    notes: int
    """Number of notes."""
    duration: float
    """From the first onset to the last offset, in s."""
    average_polyphony: float
    """How many keys are pressed at once, as a mean over the duration, in which silence counts as
    no key."""
    maximum_polyphony: int
    """The most keys pressed at once."""
    onset_density: float
    """Notes per second of the duration."""
    hand_span: int
    """The widest interval that one hand holds, in semitones."""
    hand_motion: float
    """How far a hand's centre moves per second of the duration, in semitones, as a mean over both
    hands. The centre, midway between the lowest and the highest key of a chord or on a note that
    is struck alone, moves from one to the next; a hand that does not play does not move."""
    pitch_range: tuple[int, int]
    """The lowest and the highest MIDI pitch."""


def features(score: Score) -> Features:
    """Return the features of a score.

    Hands are those of the notes; where any is unknown, they are assigned as for fingering.

    Raises:
        ScoreError: If no two hands can play the score.
    """
    duration = score.duration - score.notes[0].onset
    handed = score
    if any(note.hand is None for note in score.notes):
        handed = assign_hands(score)
    hands = [[note for note in handed.notes if note.hand == hand] for hand in HANDS]
    travel = sum(_travel(notes) for notes in hands)
    return Features(
        notes=len(score.notes),
        duration=duration,
        average_polyphony=_pressed_time(score.notes) / duration,
        maximum_polyphony=max(len(pitches) for pitches in _held(score.notes)),
        onset_density=len(score.notes) / duration,
        hand_span=max(max(held) - min(held) for notes in hands for held in _held(notes)),
        hand_motion=travel / len(hands) / duration,
        pitch_range=score.pitch_range,
    )


def _pressed_time(notes: Iterable[Note]) -> float:
    """Return the time for which keys are pressed, summed over the keys, in s."""
    total = 0.0
    pressed_until: dict[int, float] = {}
    for note in sorted(notes, key=attrgetter("onset")):
        start = max(note.onset, pressed_until.get(note.pitch, 0.0))
        if note.offset > start:
            total += note.offset - start
            pressed_until[note.pitch] = note.offset
    return total


def _held(notes: Iterable[Note]) -> Iterator[list[int]]:
    """Yield the pitches that are held after each strike."""
    held: list[Note] = []
    for note in sorted(notes, key=attrgetter("onset")):
        held = [
            other
            for other in held
            if other.pitch != note.pitch
            and (other.offset > note.onset + SAME_TIME or other.onset == note.onset)
        ]
        held.append(note)
        yield [other.pitch for other in held]


def _travel(notes: Iterable[Note]) -> float:
    """Return how far one hand's centre moves altogether, in semitones."""
    centres = [(min(chord) + max(chord)) / 2 for chord in _chords(notes)]
    return sum(abs(end - start) for start, end in itertools.pairwise(centres))


def _chords(notes: Iterable[Note]) -> list[list[int]]:
    """Return the pitches that one hand strikes together, in the order of time."""
    chords: list[list[int]] = []
    first = 0.0
    for note in sorted(notes, key=attrgetter("onset")):
        if not chords or note.onset > first + SAME_CHORD:
            chords.append([])
            first = note.onset
        chords[-1].append(note.pitch)
    return chords
