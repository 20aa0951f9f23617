"""One note, and one press of the sustain pedal."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral, Real

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import (
    DEFAULT_VELOCITY,
    MAX_PITCH,
    MIN_PITCH,
    NUM_FINGERS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.hands import HANDS, Hand, hand_of_finger


@dataclass(frozen=True, kw_only=True, slots=True)
class Note:
    """One note: which key, when, how hard, with which finger or at least which hand.

    Attributes:
        onset: When the key is struck, in s, finite and at least 0.
        offset: When the key is let go, in s, finite and later than `onset`.
        pitch: MIDI pitch, 21 (A0) to 108 (C8).
        velocity: How hard the key is struck, 1-127.
        finger: 0-4 right hand thumb to little, 5-9 left hand thumb to little, -1 unknown.
        hand: "right", "left" or None if unknown, as in a file that says which hand plays, but not
            with which finger. A finger that is known decides, whatever is given.

    Raises:
        ScoreError: If a value is not a number or out of its range.
    """

    onset: float
    offset: float
    pitch: int
    velocity: int = DEFAULT_VELOCITY
    finger: int = UNKNOWN_FINGER
    hand: Hand | None = None

    def __post_init__(self) -> None:
        _check_times(self)
        _check_integer(self, "pitch", MIN_PITCH, MAX_PITCH, "21 (A0) to 108 (C8)")
        _check_integer(self, "velocity", 1, 127, "1 to 127")
        fingers = "0-4 (right), 5-9 (left) or -1 (unknown)"
        _check_integer(self, "finger", UNKNOWN_FINGER, NUM_FINGERS - 1, fingers)
        _settle_hand(self)

    @property
    def key(self) -> int:
        """The key of the piano that this note strikes, 0-87."""
        return self.pitch - MIN_PITCH

    @property
    def duration(self) -> float:
        """How long the key is held, in s."""
        return self.offset - self.onset


@dataclass(frozen=True, kw_only=True, slots=True)
class Pedal:
    """One press of the sustain pedal.

    Attributes:
        onset: When the pedal goes down, in s, finite and at least 0.
        offset: When it comes up, in s, finite and later than `onset`.

    Raises:
        ScoreError: If a time is not a number or out of its range.
    """

    onset: float
    offset: float

    def __post_init__(self) -> None:
        _check_times(self)


def located_note(
    where: str,
    *,
    onset: float,
    offset: float,
    pitch: int,
    velocity: int = DEFAULT_VELOCITY,
    finger: int = UNKNOWN_FINGER,
    hand: Hand | None = None,
) -> Note:
    """Make a note whose error, if it is refused, says which note of which piece it was.

    Args:
        where: The place, such as ``"Note 3 of 'etude'"``.
        onset: As in `Note`, in s.
        offset: As in `Note`, in s.
        pitch: As in `Note`.
        velocity: As in `Note`.
        finger: As in `Note`.
        hand: As in `Note`.

    Raises:
        ScoreError: If `Note` refuses the values.
    """
    try:
        return Note(
            onset=onset, offset=offset, pitch=pitch, velocity=velocity, finger=finger, hand=hand
        )
    except ScoreError as error:
        text = str(error)
        raise ScoreError(f"{where}: {text[0].lower()}{text[1:]}") from error


def merge_pedals(pedals: Iterable[Pedal]) -> tuple[Pedal, ...]:
    """Sort presses by time and join those that overlap or touch."""
    merged: list[Pedal] = []
    for pedal in sorted(pedals, key=lambda pedal: (pedal.onset, pedal.offset)):
        if merged and pedal.onset <= merged[-1].offset:
            offset = max(pedal.offset, merged[-1].offset)
            merged[-1] = Pedal(onset=merged[-1].onset, offset=offset)
        else:
            merged.append(pedal)
    return tuple(merged)


def _check_times(event: Note | Pedal) -> None:
    for name in ("onset", "offset"):
        value = getattr(event, name)
        if not isinstance(value, Real) or not math.isfinite(value) or value < 0:
            raise ScoreError(f"{name.capitalize()} {value!r} is no time: expected seconds from 0.")
        # Plain floats, so that times taken from numpy arrays print and pickle as numbers.
        object.__setattr__(event, name, float(value))
    if event.offset <= event.onset:
        raise ScoreError(f"Offset {event.offset} s is not after onset {event.onset} s.")


def _check_integer(note: Note, name: str, low: int, high: int, expected: str) -> None:
    value = getattr(note, name)
    if not isinstance(value, Integral):
        raise ScoreError(f"{name.capitalize()} {value!r} is no whole number: expected {expected}.")
    if not low <= int(value) <= high:
        raise ScoreError(f"{name.capitalize()} {value} is out of range: expected {expected}.")
    object.__setattr__(note, name, int(value))


def _settle_hand(note: Note) -> None:
    if note.hand is not None and note.hand not in HANDS:
        raise ScoreError(f"Hand {note.hand!r} is not valid: expected 'right', 'left' or None.")
    object.__setattr__(note, "hand", hand_of_finger(note.finger) or note.hand)
