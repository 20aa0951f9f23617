"""Key presses with their fingers, from state to state of the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sb3_piano.music.constants import FINGERS_PER_HAND, UNKNOWN_FINGER
from sb3_piano.music.roll import PianoRoll


@dataclass(frozen=True)
class Press:
    """A key press by a finger.

    Control step t leads from state t to state t + 1, whose sound is compared with the goal of step
    t. The key must be down in the states ``first`` to ``last``.
    """

    key: int
    """0 to 87."""
    finger: int
    """0 (thumb) to 4 (little finger) of the hand."""
    first: int
    """First state in which the key is down, 1 or more."""
    last: int
    """Last state in which the key is down, ``first`` or more."""
    velocity: int = 0
    """MIDI velocity of the strike; 0 if the key is down already, by another finger."""


def presses_of_hand(roll: PianoRoll, hand: int) -> list[Press]:
    """List the presses of a hand, 0 (right) or 1 (left), in order of time, then key."""
    presses = []
    for key in np.flatnonzero((roll.finger // FINGERS_PER_HAND == hand).any(axis=0)).tolist():
        # The rest of a note that outlasts another one on its key has its own label: a new press.
        finger = np.where(roll.active[:, key], roll.finger[:, key], UNKNOWN_FINGER)
        changes = np.flatnonzero((np.diff(finger) != 0) | roll.onset[1:, key]) + 1
        starts = np.concatenate([[0], changes]).tolist()
        ends = np.concatenate([changes, [len(finger)]]).tolist()
        for start, end in zip(starts, ends, strict=True):
            label = int(finger[start])
            if label >= 0 and label // FINGERS_PER_HAND == hand:
                finger_of_hand, struck = label % FINGERS_PER_HAND, int(roll.velocity[start, key])
                presses.append(Press(key, finger_of_hand, start + 1, end, struck))
    return sorted(presses, key=lambda press: (press.first, press.key))
