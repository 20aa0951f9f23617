"""Building blocks of the studies: keys, sequences of notes, and options."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from sb3_piano.music.constants import MAX_PITCH
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score
from sb3_piano.settings import Count, Number, Unit, Whole, checked

MAJOR_SCALE = (0, 2, 4, 5, 7, 9, 11)
"""The seven notes of a major scale, in semitones above the first."""

KeyPress = tuple[int, int]
"""A MIDI pitch and the finger (0-9) that strikes it."""

_MIN_TEMPO, _MAX_TEMPO = 1.0, 1000.0
"""Slowest and fastest tempo, in quarter notes a minute, beyond human limits."""

_Tempo = Annotated[Number, Ge(_MIN_TEMPO), Le(_MAX_TEMPO), Unit("quarter notes a minute")]


def in_sequence(
    groups: Iterable[tuple[Iterable[KeyPress], float]], title: str, *, bars: Container[int] = ()
) -> Score:
    """Make a score of groups of keys, one after the other, each with its length in s.

    ``bars`` are the indices of the groups that begin a bar.
    """
    notes: list[Note] = []
    lines: list[float] = []
    onset = 0.0
    for index, (presses, duration) in enumerate(groups):
        if index in bars:
            lines.append(onset)
        offset = onset + duration
        notes += [
            Note(onset=onset, offset=offset, pitch=pitch, finger=finger)
            for pitch, finger in presses
        ]
        onset = offset
    return Score(notes=notes, title=title, bars=lines)


def option_meanings(*, tempo: int, octaves: int) -> dict[str, str]:
    """Describe the options of all studies by name, with a study's own defaults."""
    return {
        "tempo": f"quarter notes a minute, {_MIN_TEMPO:g} to {_MAX_TEMPO:g} (default {tempo})",
        "hands": "hands that play: both (default), right or left",
        "repeats": "number of times in a row, 1 or more (default 1)",
        "octaves": f"number of octaves, as far as the keyboard allows (default {octaves})",
    }


def checked_options(tempo: Any, hands: Any, repeats: Any) -> tuple[float, tuple[Hand, ...], int]:
    """Validate options: return the length of a quarter note in s, the hands, and the repeats.

    Raises:
        ConfigError: If a value is not valid.
    """
    seconds = 60.0 / float(checked("tempo", tempo, _Tempo))
    chosen: Hand | Literal["both"] = checked("hands", hands, Literal["both", "right", "left"])
    times: int = checked("repeats", repeats, Count)
    return seconds, HANDS if chosen == "both" else (chosen,), times


def in_octaves(
    way: Callable[[int], Sequence[tuple[int, Mapping[Hand, int]]]],
    octaves: Any,
    first: Mapping[Hand, int],
) -> list[tuple[KeyPress, ...]]:
    """Return the keys that the hands strike together, one group after the other.

    ``way`` maps a number of octaves to the notes, in semitones above the first of each hand (a MIDI
    pitch), with the pianists' finger numbers.

    Raises:
        ConfigError: If `octaves` is not a whole number, is less than 1, or leaves the keyboard.
    """
    highest = max(first.values()) + max(interval for interval, _ in way(1))
    limit = 1 + (MAX_PITCH - highest) // 12
    kind = Annotated[Whole, Ge(1), Le(limit), Unit(", as the keyboard ends there")]
    return [
        tuple((pitch + interval, finger_of(hand, numbers[hand])) for hand, pitch in first.items())
        for interval, numbers in way(int(checked("octaves", octaves, kind)))
    ]
