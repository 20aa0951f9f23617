"""Hanon's The Virtuoso Pianist, exercises 1 to 20.

In each, a bar of eight sixteenths climbs the white keys a step at a time for two octaves. Another
bar descends again, and a last C lasts a bar. Both hands play an octave apart: the left hand starts
two octaves below middle C, the right hand one octave below, as printed. The simulated forearms have
less room than in the scales, where the hands are two octaves apart.

Source: C. L. Hanon, The Virtuoso Pianist (1873), part I, in the edition of G. Schirmer (1900) from
the Mutopia Project. All notes agree with an independent table of the MIDI files of
yogibooboo/Hanon_Test, and the bars with an example of the package pytakt.

Exact: every note, also in the altered bars at the turns (nos. 6, 7, 9, 12, 14, 15, 17, 18, 20; only
the fingers are altered in 7, 14 and 18); the number of bars; the chord that ends no. 20; and the
printed fingers, which the first bars of each direction have. Regularised: bars without printed
fingers repeat the fingers of the bars before. Ours: the fingers of the altered bars of nos. 6, 12
and 17 and of the last notes, most of which have none in print.

Tempo: the slowest of the edition, quarter note = 60 (of 60 to 108). The edition repeats everything
before the last C, as ``repeats=2`` does. In other keys than C, the bars are transposed up to six
semitones up or five down, and the fingers stay the same, as is the custom.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from sb3_piano.files import read_table
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies.building import (
    MAJOR_SCALE,
    checked_options,
    in_octaves,
    in_sequence,
    option_meanings,
)
from sb3_piano.settings import checked

_FIRST_C: Mapping[Hand, int] = MappingProxyType({"right": 48, "left": 36})
"""MIDI pitch of each hand's first C: C3 and C2."""

_KEYS = ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")
"""The major keys, indexed by semitones from C up to the first note."""

_TEMPO = 60
_OCTAVES = 2
_NOTES_PER_BAR = 8
_NOTES_PER_QUARTER = 4
_DEGREES = len(MAJOR_SCALE)
_MOST_UP = 6
"""Keys more semitones above C than this are played below it, to stay near."""

_LAST_NOTES = {"right": [(0, 1)], "left": [(0, 5)]}
"""The default last notes of each hand, (degree, finger)."""


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
    """Make one of Hanon's exercises, 1 to 20; :func:`option_meanings` describes the options.

    Raises:
        ConfigError: If a value is not valid, or the octaves do not fit on the keyboard.
    """
    quarter, players, times = checked_options(tempo, hands, repeats)
    seconds = quarter / _NOTES_PER_QUARTER
    semitones = _KEYS.index(checked("key", key, Literal[_KEYS]))
    semitones -= 12 if semitones > _MOST_UP else 0
    first = {hand: _FIRST_C[hand] + semitones for hand in players}
    exercise = _exercises()[number]
    body = in_octaves(partial(_way, exercise), octaves, first) * times
    end = [
        (pitch + _interval(degree), finger_of(hand, finger))
        for hand, pitch in first.items()
        for degree, finger in exercise.get(f"{hand}_end", _LAST_NOTES[hand])
    ]
    groups = [(together, seconds) for together in body]
    bars = range(0, len(groups) + 1, _NOTES_PER_BAR)
    return in_sequence([*groups, (end, _NOTES_PER_BAR * seconds)], title, bars=bars)


@lru_cache(maxsize=1)
def _exercises() -> dict[int, dict[str, Any]]:
    exercises: dict[int, dict[str, Any]] = read_table(Path(__file__).with_suffix(".yml"))
    return exercises


def _way(exercise: Mapping[str, Any], octaves: int) -> list[tuple[int, dict[Hand, int]]]:
    """Return the notes before the last one: semitones above the first C, and fingers."""
    last_c = _DEGREES * octaves
    up = [(exercise["up"], step) for step in range(last_c + exercise.get("more_up", 0))]
    falls = range(last_c + exercise.get("more_down", 0))
    down = [(exercise["down"], last_c - step) for step in falls]
    up[0] = (exercise.get("opening", exercise["up"]), 0)
    up[-1] = (exercise["top"], last_c) if "top" in exercise else up[-1]
    down[-1] = (exercise["bottom"], 0) if "bottom" in exercise else down[-1]
    return [
        (_interval(int(degree) + shift), dict(zip(HANDS, map(int, fingers), strict=True)))
        for (degrees, *digits), shift in chain(up, down)
        for degree, *fingers in zip(degrees.split(), *digits, strict=True)
    ]


def _interval(degree: int) -> int:
    """Convert a degree of the C major scale to semitones from C."""
    octave, step = divmod(degree, _DEGREES)
    return 12 * octave + MAJOR_SCALE[step]


def _piece(number: int) -> Piece:
    name = f"hanon-{number:02}"
    return Piece(
        name=name,
        title=f"Hanon's exercise no. {number}",
        collection="hanon",
        source="C. L. Hanon, The Virtuoso Pianist (1873; Schirmer 1900)",
        fingering="Hanon's",
        composer="Charles-Louis Hanon (1819-1900)",
        build=partial(hanon, number=number, title=name),
        options={
            **option_meanings(tempo=_TEMPO, octaves=_OCTAVES),
            "key": f"major key: {', '.join(_KEYS)} (default C)",
        },
    )


HANON: Mapping[str, Piece] = MappingProxyType(
    {piece.name: piece for piece in map(_piece, range(1, 21))}
)
"""Hanon's exercises by name: ``hanon-01`` to ``hanon-20``."""
