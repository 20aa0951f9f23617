"""Up and down again: what scales and arpeggios have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from sb3_piano.music.hands import Hand, finger_of
from sb3_piano.music.piece import Piece
from sb3_piano.music.score import Score
from sb3_piano.music.studies.options import (
    checked_octaves,
    checked_repeats,
    chosen_hands,
    option_meanings,
    quarter_duration,
)
from sb3_piano.music.studies.sequence import Touch, in_sequence

FIRST_C: Mapping[Hand, int] = MappingProxyType({"right": 72, "left": 48})
"""MIDI pitch of the C from which each hand counts: C5 and C3, as in RoboPianist's scales.

Two octaves lie between the hands, so that the simulated forearms have room.
"""

_TEMPO = 80
_BEATS_PER_BAR = 4
_OCTAVE = 12


@dataclass(frozen=True, kw_only=True)
class Run:
    """Notes that lead up the keyboard in quarter notes of 4/4, and down again the same way.

    Attributes:
        name: Name of the piece.
        tonic: Semitones from C up to the first note, 0-11.
        steps: The notes of one octave, in semitones above the first, which is 0.
        fingers: For each hand the pianists' numbers of the fingers on the way up two octaves, the
            way charts print them: one digit a note. More octaves go on as the second does.
    """

    name: str
    tonic: int
    steps: tuple[int, ...]
    fingers: Mapping[Hand, str]

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
        seconds = quarter_duration(tempo)
        players = chosen_hands(hands)
        times = checked_repeats(repeats)
        highest = max(FIRST_C[hand] for hand in players) + self.tonic + _OCTAVE
        span = checked_octaves(octaves, highest)
        touches = [self._touches(hand, span) for hand in players]
        groups = [(together, seconds) for together in zip(*touches, strict=True)]
        groups += [((), seconds)] * (-len(groups) % _BEATS_PER_BAR)
        bars = range(0, times * len(groups), _BEATS_PER_BAR)
        return in_sequence(groups * times, self.name, bars=bars)

    def _touches(self, hand: Hand, octaves: int) -> list[Touch]:
        first = FIRST_C[hand] + self.tonic
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


def run_piece(run: Run, *, title: str, collection: str, source: str) -> Piece:
    """Return the piece that plays a run, with the options that runs have."""
    return Piece(
        name=run.name,
        title=title,
        collection=collection,
        source=source,
        fingering="standard",
        build=run.score,
        options=option_meanings(tempo=_TEMPO, octaves=1),
    )
