"""Notes one after the other, each held until the next."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import TypeAlias

from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

Touch: TypeAlias = tuple[int, int]
"""A MIDI pitch and the finger (0-9) that strikes it."""


def in_sequence(
    groups: Iterable[tuple[Iterable[Touch], float]], title: str, *, bars: Container[int] = ()
) -> Score:
    """Play groups of keys one after the other, each held until the next.

    Args:
        groups: For each group its touches and its length in s.
        title: Title of the score.
        bars: Indices of the groups with which a bar begins.
    """
    notes: list[Note] = []
    lines: list[float] = []
    onset = 0.0
    for index, (touches, duration) in enumerate(groups):
        if index in bars:
            lines.append(onset)
        offset = onset + duration
        notes += [
            Note(onset=onset, offset=offset, pitch=pitch, finger=finger)
            for pitch, finger in touches
        ]
        onset = offset
    return Score(notes=notes, title=title, bars=lines)
