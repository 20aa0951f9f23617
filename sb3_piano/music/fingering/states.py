"""Keys held at a time in one hand's part, and all fingerings of them.

Keys are pitches in the right hand's view: the left hand's are mirrored about D, after which its
part looks like one of the right hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import FINGERS_PER_HAND, THUMB, UNKNOWN_FINGER
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note

TOGETHER = 0.03
"""Notes struck within this time of the first, in s, are one chord."""

OVERLAP = 0.05
"""A key that is let go within this time, in s, after the next is struck counts as let go before.

Legato is played with a little overlap. It is one control step of RoboPianist (20 Hz).
"""

MIRROR = 2 * 62
"""Sum of a pitch and its mirror image: D4 is its own."""

Shape = tuple[tuple[bool, int], ...]
"""For each key from the thumb's side: whether it is struck now (else held), its known finger."""

States = NDArray[np.intp]
"""(states, keys): the finger, 0 (thumb) to 4, on each key."""

_CACHE = 8192


@dataclass(slots=True)
class KeyStrike:
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


def slices(notes: Sequence[Note], hand: Hand) -> list[list[KeyStrike]]:
    """Return what `hand` strikes at a time, in order of keys from the thumb's side.

    Args:
        notes: The notes of the hand, sorted by onset.
        hand: Whose they are.
    """
    groups: list[tuple[float, dict[int, KeyStrike]]] = []
    for index, note in enumerate(notes):
        if not groups or note.onset > groups[-1][0] + TOGETHER:
            groups.append((note.onset, {}))
        key = note.pitch if hand == "right" else MIRROR - note.pitch
        first = KeyStrike(key, note.onset, note.offset, [], UNKNOWN_FINGER)
        strike = groups[-1][1].setdefault(key, first)
        strike.notes.append(index)
        strike.offset = max(strike.offset, note.offset)
        if strike.label == UNKNOWN_FINGER != note.finger:
            strike.label = note.finger % FINGERS_PER_HAND
    return [[group[key] for key in sorted(group)] for _, group in groups]


class Pattern(NamedTuple):
    """Keys held in a slice, whenever and in whichever octave it is played.

    Attributes:
        pitch_class: Of the lowest key, 0 is C.
        intervals: Of each key above the lowest, in semitones.
        shape: Which keys are struck, and the fingers known beforehand.
        in_order: Whether fingers follow the order of the keys.
    """

    pitch_class: int
    intervals: tuple[int, ...]
    shape: Shape
    in_order: bool = True

    @property
    def states(self) -> States:
        """Ways to lay fingers on it."""
        return finger_states(self.shape, self.in_order)

    @property
    def struck(self) -> list[int]:
        """Places of the keys that are struck."""
        return [place for place, (struck, _) in enumerate(self.shape) if struck]


@lru_cache(maxsize=_CACHE)
def finger_states(shape: Shape, in_order: bool = True) -> States:
    """Return every way to lay fingers on the keys, in a definite order.

    Each key has a finger of its own, and fingers follow the order of the keys. Two exceptions:
    the thumb may have passed under fingers that hold keys, or fingers over a thumb that does;
    and labels stay as they are, even if two contradict each other.

    Args:
        shape: The keys.
        in_order: Whether fingers follow the order of the keys.

    Returns:
        (states, keys); no states if the labels leave no finger for another key.
    """
    found: list[tuple[int, ...]] = [()]
    for place, key in enumerate(shape):
        found = [
            (*fingers, finger)
            for fingers in found
            for finger in (range(FINGERS_PER_HAND) if key[1] < 0 else (key[1],))
            if all(
                _fit(shape[below], fingers[below], key, finger, in_order) for below in range(place)
            )
        ]
    return np.array(found, dtype=np.intp).reshape(len(found), len(shape))


def _fit(
    lower: tuple[bool, int], low: int, upper: tuple[bool, int], high: int, in_order: bool
) -> bool:
    if lower[1] >= 0 and upper[1] >= 0:
        return True
    if low == high or not in_order:
        return low != high
    both_struck = lower[0] and upper[0]
    return low < high or (high == THUMB and not both_struck)


@lru_cache(maxsize=_CACHE)
def playable(shape: Shape) -> tuple[tuple[int, ...], bool]:
    """Return the places of the keys that get a finger, and whether fingers follow their order.

    A struck key goes without a finger only if more than five are struck: then the outer ones come
    first. Fingers leave the order of the keys only where labels give them no other way.
    """
    labelled = [place for place, (_, label) in enumerate(shape) if label >= 0]
    free = [place for place, (_, label) in enumerate(shape) if label < 0]
    for count in range(min(len(free), FINGERS_PER_HAND), 0, -1):
        # Turn by turn from both ends.
        outer = [free[turn // 2 if turn % 2 == 0 else -1 - turn // 2] for turn in range(count)]
        places = tuple(sorted([*labelled, *outer]))
        chosen = tuple(shape[place] for place in places)
        for in_order in (True, False):
            if len(finger_states(chosen, in_order)):
                return places, in_order
    return tuple(labelled), True
