"""The slices of one hand's part: keys struck together, and those that are still held.

Keys are pitches in the right hand's view: the left hand's are mirrored about D (`mirrored`), after
which its part looks like one of the right hand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sb3_piano.music.constants import FINGERS_PER_HAND, UNKNOWN_FINGER
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note

TOGETHER = 0.03
"""Notes struck within this time of the first, in s, are one chord."""

OVERLAP = 0.05
"""A key that is let go within this time, in s, after the next is struck counts as let go before.

Legato is played with a little overlap. It is one control step of RoboPianist (20 Hz).
"""

MIRROR = 2 * 62
"""What a pitch and its mirror image add up to: D4 is its own."""


@dataclass(slots=True)
class Touch:
    """A key that a hand strikes, once; notes that double each other share one.

    Attributes:
        key: Pitch in the right hand's view.
        onset: When it is struck, in s.
        offset: When it is let go, in s.
        notes: Indices of its notes in the part.
        label: Finger (0 thumb to 4) that plays it, if that is known beforehand, else -1.
    """

    key: int
    onset: float
    offset: float
    notes: list[int]
    label: int


def mirrored(pitch: int, hand: Hand) -> int:
    """Return the pitch in the right hand's view: itself, or its mirror image for the left."""
    return pitch if hand == "right" else MIRROR - pitch


def slices(notes: Sequence[Note], hand: Hand) -> Iterator[list[Touch]]:
    """Yield what `hand` strikes at a time, in order of keys from the thumb's side.

    Args:
        notes: The notes of the hand, sorted by onset.
        hand: Whose they are.
    """
    group: dict[int, Touch] = {}
    start = 0.0
    for index, note in enumerate(notes):
        if group and note.onset > start + TOGETHER:
            yield _in_order(group)
            group = {}
        if not group:
            start = note.onset
        _add(group, index, note, mirrored(note.pitch, hand))
    if group:
        yield _in_order(group)


def _in_order(group: dict[int, Touch]) -> list[Touch]:
    return [group[key] for key in sorted(group)]


def _add(group: dict[int, Touch], index: int, note: Note, key: int) -> None:
    label = UNKNOWN_FINGER if note.finger == UNKNOWN_FINGER else note.finger % FINGERS_PER_HAND
    if key not in group:
        group[key] = Touch(key, note.onset, note.offset, [index], label)
        return
    touch = group[key]
    touch.notes.append(index)
    touch.offset = max(touch.offset, note.offset)
    if touch.label == UNKNOWN_FINGER:
        touch.label = label
