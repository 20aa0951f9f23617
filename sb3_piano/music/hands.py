"""The two hands, and their fingers by number."""

from __future__ import annotations

from typing import Literal

from sb3_piano.music.constants import FINGERS_PER_HAND, UNKNOWN_FINGER

Hand = Literal["right", "left"]

HANDS: tuple[Hand, Hand] = ("right", "left")
"""Both hands, in the order of their fingers: 0-4 are the right hand's, 5-9 the left hand's."""


def hand_of_finger(finger: int) -> Hand | None:
    """Return the hand of a finger (0-9), or None for an unknown one (-1)."""
    return None if finger == UNKNOWN_FINGER else HANDS[finger // FINGERS_PER_HAND]


def finger_of(hand: Hand, number: int) -> int:
    """Return the finger (0-9) of a hand by the pianists' number (1 thumb to 5 little)."""
    return HANDS.index(hand) * FINGERS_PER_HAND + number - 1


def fingers_of(hand: Hand) -> range:
    """Return the fingers (0-9) of a hand, thumb to little."""
    first = HANDS.index(hand) * FINGERS_PER_HAND
    return range(first, first + FINGERS_PER_HAND)


def finger_number(finger: int) -> int:
    """Return the pianists' number (1 thumb to 5 little) of a finger (0-9)."""
    return finger % FINGERS_PER_HAND + 1


def likely_hand(pitch: int) -> Hand:
    """Guess the hand of a MIDI pitch: the right from middle C (60) up."""
    return "right" if pitch >= 60 else "left"
