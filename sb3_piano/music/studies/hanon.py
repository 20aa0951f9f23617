"""Hanon's The Virtuoso Pianist, exercises 1 to 20.

Each is one bar of eight sixteenths that climbs the white keys a step at a time for two octaves,
and another that falls back, both hands an octave apart, then a last C for a bar. The left hand
starts from the C two octaves below middle C, the right from the one below middle C, as printed;
the simulated forearms have less room than in the scales, where the hands are two octaves apart.

Source: C. L. Hanon, The Virtuoso Pianist (1873), part I, in the edition of G. Schirmer (1900), as
the Mutopia Project gives it. All notes agree with a table that others made of the MIDI files of
yogibooboo/Hanon_Test, and the bars with those that the package pytakt has as an example.

Exact: every note of every bar, the altered bars at the turns included (nos. 6, 7, 9, 12, 14, 15,
17, 18, 20; in 7, 14 and 18 only the fingers are); the number of bars; the chord that ends no. 20;
and the fingers where the edition prints them, which is throughout the first bars of each way.
Regularised: bars without printed fingers have those of the bars before. Ours: the fingers of the
altered bars of nos. 6, 12 and 17 and of the last notes, most of which have none.

Tempo: the slowest that the edition gives, quarter note = 60 (of 60 to 108). The edition repeats
everything before the last C, as ``repeats=2`` does. In other keys than C, in which Hanon's bars
are transposed up to six semitones up or five down, the fingers stay the same, as is the custom.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, Literal

from sb3_piano.music.hands import Hand, finger_of
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies.building import (
    MAJOR_KEYS,
    MAJOR_SCALE,
    KeyPress,
    checked_octaves,
    checked_options,
    in_sequence,
    option_meanings,
)
from sb3_piano.music.studies.hanon_bars import EXERCISES, Exercise, HanonBar
from sb3_piano.settings import checked

_FIRST_C: Mapping[Hand, int] = MappingProxyType({"right": 48, "left": 36})
"""MIDI pitch of the C from which each hand starts: C3 and C2."""

_TEMPO = 60
_OCTAVES = 2
_NOTES_PER_BAR = 8
_NOTES_PER_QUARTER = 4
_DEGREES = len(MAJOR_SCALE)
_MOST_UP = 6
"""Keys more semitones above C than this are below it instead, so that none is far from it."""


def hanon(
    *,
    number: int,
    title: str,
    tempo: Any = _TEMPO,
    hands: Any = "both",
    repeats: Any = 1,
    octaves: Any = _OCTAVES,
    key: Any = "C",
) -> Score:
    """Play one of Hanon's exercises.

    Args:
        number: Which one, 1 to 20.
        title: Title of the score.
        tempo: Quarter notes a minute.
        hands: "both", "right" or "left".
        repeats: How many times it is played before the last note.
        octaves: How many octaves it climbs.
        key: Name of a major key, such as "Eb".

    Raises:
        ConfigError: If a value is not valid, or the octaves do not fit on the keyboard.
    """
    quarter, players, times = checked_options(tempo, hands, repeats)
    seconds = quarter / _NOTES_PER_QUARTER
    first = {hand: _FIRST_C[hand] + _semitones(key) for hand in players}
    exercise = EXERCISES[number]
    one_octave = [_body(exercise, hand, first[hand], octaves=1) for hand in players]
    highest = max(pitch for presses in one_octave for pitch, _ in presses)
    span = checked_octaves(octaves, highest)
    body = [_body(exercise, hand, first[hand], span) for hand in players]
    groups = [(together, seconds) for together in zip(*body, strict=True)] * times
    end = tuple(press for hand in players for press in _end(exercise, hand, first[hand]))
    bars = range(0, len(groups) + 1, _NOTES_PER_BAR)
    return in_sequence([*groups, (end, _NOTES_PER_BAR * seconds)], title, bars=bars)


def _semitones(key: Any) -> int:
    """Return how many semitones the exercise in a key is above that in C."""
    semitones = MAJOR_KEYS.index(checked("key", key, Literal[MAJOR_KEYS]))
    return semitones if semitones <= _MOST_UP else semitones - 12


def _body(exercise: Exercise, hand: Hand, first: int, octaves: int) -> list[KeyPress]:
    """Return what a hand plays before the last note."""
    return [
        (_pitch(first, degree + shift), finger_of(hand, number))
        for bar, shift in _bars(exercise, octaves)
        for degree, number in zip(bar.degrees, bar.fingers[hand], strict=True)
    ]


def _end(exercise: Exercise, hand: Hand, first: int) -> Iterator[KeyPress]:
    presses = exercise.right_end if hand == "right" else exercise.left_end
    for degree, number in presses:
        yield _pitch(first, degree), finger_of(hand, number)


def _bars(exercise: Exercise, octaves: int) -> list[tuple[HanonBar, int]]:
    """Return the bars on the way up and down, each with the degrees by which it is shifted."""
    last_c = _DEGREES * octaves
    up = [(exercise.up, step) for step in range(last_c + exercise.more_up)]
    down = [(exercise.down, last_c - step) for step in range(last_c + exercise.more_down)]
    if exercise.opening is not None:
        up[0] = (exercise.opening, 0)
    if exercise.top is not None:
        up[-1] = (exercise.top, last_c)
    if exercise.bottom is not None:
        down[-1] = (exercise.bottom, 0)
    return up + down


def _pitch(first: int, degree: int) -> int:
    octave, step = divmod(degree, _DEGREES)
    return first + 12 * octave + MAJOR_SCALE[step]


def _piece(number: int) -> Piece:
    name = f"hanon-{number:02}"
    return Piece(
        name=name,
        title=f"Hanon's exercise no. {number}",
        collection="hanon",
        source="C. L. Hanon, The Virtuoso Pianist (1873; Schirmer 1900)",
        fingering="Hanon's",
        build=partial(hanon, number=number, title=name),
        options={
            **option_meanings(tempo=_TEMPO, octaves=_OCTAVES),
            "key": f"major key: {', '.join(MAJOR_KEYS)} (default C)",
        },
    )


HANON: Mapping[str, Piece] = MappingProxyType(
    {piece.name: piece for piece in map(_piece, EXERCISES)}
)
"""Hanon's exercises by name: ``hanon-01`` to ``hanon-20``."""
