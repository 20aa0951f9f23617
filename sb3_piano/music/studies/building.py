"""Building blocks of the studies: keys, notes in sequence, and the options that may be chosen."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, Literal

from annotated_types import Ge, Le

from sb3_piano.music.constants import MAX_PITCH
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.settings import Count, Number, Unit, Whole, checked

MAJOR_SCALE = (0, 2, 4, 5, 7, 9, 11)
"""The seven notes of a major scale, in semitones above its first."""

MAJOR_KEYS = ("C", "Db", "D", "Eb", "E", "F", "Gb", "G", "Ab", "A", "Bb", "B")
"""The major keys, by semitones from C up to the first note."""

MINOR_KEYS = ("C", "CSharp", "D", "Eb", "E", "F", "FSharp", "G", "GSharp", "A", "Bb", "B")
"""The same of the minor keys."""

KeyPress = tuple[int, int]
"""A MIDI pitch and the finger (0-9) that strikes it."""

_FIRST_C: Mapping[Hand, int] = MappingProxyType({"right": 72, "left": 48})
"""MIDI pitch of the C from which each hand counts: C5 and C3, as in RoboPianist's scales.

Two octaves lie between the hands, so that the simulated forearms have room.
"""

_TEMPO = 80
_BEATS_PER_BAR = 4
_OCTAVE = 12

_MIN_TEMPO, _MAX_TEMPO = 1.0, 1000.0
"""Slowest and fastest tempo, in quarter notes a minute: wider than anybody plays."""

_Tempo = Annotated[Number, Ge(_MIN_TEMPO), Le(_MAX_TEMPO), Unit("quarter notes a minute")]


def spoken(key: str) -> str:
    """Return the name of a key as it is read: ``"B flat"``, ``"C sharp"``."""
    return f"{key[0]}{key[1:].replace('Sharp', ' sharp').replace('b', ' flat')}"


def in_sequence(
    groups: Iterable[tuple[Iterable[KeyPress], float]], title: str, *, bars: Container[int] = ()
) -> Score:
    """Play groups of keys one after the other, each held until the next.

    Args:
        groups: For each group its presses and its length in s.
        title: Title of the score.
        bars: Indices of the groups with which a bar begins.
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
    """Return what the options that all studies have mean, by name.

    Args:
        tempo: The study's own tempo, in quarter notes a minute.
        octaves: How many octaves it spans by itself.
    """
    return {
        "tempo": f"quarter notes a minute, {_MIN_TEMPO:g} to {_MAX_TEMPO:g} (default {tempo})",
        "hands": "who plays: both (default), right or left",
        "repeats": "how many times in a row it is played, 1 or more (default 1)",
        "octaves": f"how many octaves it climbs, as far as the keyboard goes (default {octaves})",
    }


def checked_options(tempo: Any, hands: Any, repeats: Any) -> tuple[float, tuple[Hand, ...], int]:
    """Return the length of a quarter note in s, the hands that play, and how many times.

    Raises:
        ConfigError: If a value is not valid.
    """
    seconds = 60.0 / float(checked("tempo", tempo, _Tempo))
    chosen: Hand | Literal["both"] = checked("hands", hands, Literal["both", "right", "left"])
    times: int = checked("repeats", repeats, Count)
    return seconds, HANDS if chosen == "both" else (chosen,), times


def checked_octaves(octaves: Any, highest: int) -> int:
    """Return how many octaves a study climbs.

    Args:
        octaves: What was chosen.
        highest: The highest MIDI pitch of the hands that play, were it one octave.

    Raises:
        ConfigError: If `octaves` is no whole number, less than 1, or leaves the keyboard.
    """
    limit = 1 + (MAX_PITCH - highest) // 12
    kind = Annotated[Whole, Ge(1), Le(limit), Unit(", as the keyboard ends there")]
    return int(checked("octaves", octaves, kind))


@dataclass(frozen=True, kw_only=True)
class UpAndDown:
    """Notes that lead up the keyboard in quarter notes of 4/4, and down again the same way.

    Attributes:
        name: Name of the piece, which starts with its collection.
        tonic: Semitones from C up to the first note, 0-11.
        steps: The notes of one octave, in semitones above the first, which is 0.
        fingers: For each hand the pianists' numbers of the fingers on the way up two octaves, the
            way charts print them: one digit a note. More octaves go on as the second does.
    """

    name: str
    tonic: int
    steps: tuple[int, ...]
    fingers: Mapping[Hand, str]

    def piece(self, title: str, source: str = "generated") -> Piece:
        """Return the piece, with its options."""
        return Piece(
            name=self.name,
            title=title,
            collection=self.name.partition("-")[0],
            source=source,
            fingering="standard",
            build=self.score,
            options=option_meanings(tempo=_TEMPO, octaves=1),
        )

    def score(
        self, *, tempo: Any = _TEMPO, hands: Any = "both", repeats: Any = 1, octaves: Any = 1
    ) -> Score:
        """Play it.

        Args:
            tempo: Quarter notes a minute.
            hands: "both", "right" or "left".
            repeats: How many times it is played. Each time begins with a bar of its own.
            octaves: How many octaves it climbs.

        Raises:
            ConfigError: If a value is not valid, or the octaves do not fit on the keyboard.
        """
        seconds, players, times = checked_options(tempo, hands, repeats)
        highest = max(_FIRST_C[hand] for hand in players) + self.tonic + _OCTAVE
        span = checked_octaves(octaves, highest)
        presses = [self._presses(hand, span) for hand in players]
        groups = [(together, seconds) for together in zip(*presses, strict=True)]
        groups += [((), seconds)] * (-len(groups) % _BEATS_PER_BAR)
        bars = range(0, times * len(groups), _BEATS_PER_BAR)
        return in_sequence(groups * times, self.name, bars=bars)

    def _presses(self, hand: Hand, octaves: int) -> list[KeyPress]:
        first = _FIRST_C[hand] + self.tonic
        pitches = [first + _OCTAVE * octave + s for octave in range(octaves) for s in self.steps]
        pitches.append(first + _OCTAVE * octaves)
        fingers = [finger_of(hand, number) for number in self._numbers(hand, octaves)]
        up = list(zip(pitches, fingers, strict=True))
        return up + up[-2::-1]

    def _numbers(self, hand: Hand, octaves: int) -> list[int]:
        """Return the numbers of the fingers on the way up."""
        two_octaves, size = self.fingers[hand], len(self.steps)
        inner = two_octaves[size : 2 * size] * (octaves - 1)
        return [int(digit) for digit in two_octaves[:size] + inner + two_octaves[-1]]
