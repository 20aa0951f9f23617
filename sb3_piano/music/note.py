"""A note, and a press of the sustain pedal."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import (
    DEFAULT_VELOCITY,
    MAX_PITCH,
    MIN_PITCH,
    NUM_FINGERS,
    UNKNOWN_FINGER,
)
from sb3_piano.music.hands import HANDS, Hand, hand_of_finger

_RANGES = {
    "pitch": (MIN_PITCH, MAX_PITCH, "21 (A0) to 108 (C8)"),
    "velocity": (1, 127, "1 to 127"),
    "finger": (UNKNOWN_FINGER, NUM_FINGERS - 1, "0-4 (right), 5-9 (left) or -1 (unknown)"),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Note:
    """A note: key, times, velocity, and the finger or at least the hand.

    Attributes:
        onset: Time of the strike, in s, finite and at least 0.
        offset: Time of the release, in s, finite and later than `onset`.
        pitch: MIDI pitch, 21 (A0) to 108 (C8).
        velocity: MIDI velocity of the strike, 1-127.
        finger: 0-4 right hand thumb to little, 5-9 left hand thumb to little, -1 unknown.
        hand: "right", "left", or None if unknown. A file may give the hand without the finger. The
            hand of a known finger replaces `hand`.

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
        for name, (low, high, expected) in _RANGES.items():
            value = getattr(self, name)
            if not isinstance(value, Integral):
                problem = "is no whole number"
            elif not low <= int(value) <= high:
                problem = "is out of range"
            else:
                object.__setattr__(self, name, int(value))
                continue
            raise ScoreError(f"{name.capitalize()} {value!r} {problem}: expected {expected}.")
        if self.hand is not None and self.hand not in HANDS:
            raise ScoreError(f"Hand {self.hand!r} is not valid: expected 'right', 'left' or None.")
        object.__setattr__(self, "hand", hand_of_finger(self.finger) or self.hand)

    @property
    def key(self) -> int:
        """The note's key on the piano, 0-87."""
        return self.pitch - MIN_PITCH

    @property
    def duration(self) -> float:
        """Time between strike and release, s."""
        return self.offset - self.onset


@dataclass(frozen=True, kw_only=True, slots=True)
class Pedal:
    """A press of the sustain pedal.

    Attributes:
        onset: Time at which the pedal goes down, in s, finite and at least 0.
        offset: Time at which it comes up, in s, finite and later than `onset`.

    Raises:
        ScoreError: If a time is not a number or out of its range.
    """

    onset: float
    offset: float

    def __post_init__(self) -> None:
        _check_times(self)


def located_note(where: str, **fields: Any) -> Note:
    """Create a note; an error names its place: ``"Note 3 of 'etude'"``.

    Raises:
        ScoreError: If `Note` refuses the values.
    """
    try:
        return Note(**fields)
    except ScoreError as error:
        text = str(error)
        raise ScoreError(f"{where}: {text[0].lower()}{text[1:]}") from error


def merge_pedals(pedals: Iterable[Pedal]) -> tuple[Pedal, ...]:
    """Sort presses by time, and join overlapping or touching ones."""
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
        # Plain floats, so that times from NumPy arrays print and pickle as numbers.
        object.__setattr__(event, name, float(value))
    if event.offset <= event.onset:
        raise ScoreError(f"Offset {event.offset} s is not after onset {event.onset} s.")
