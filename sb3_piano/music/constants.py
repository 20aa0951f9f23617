"""Constants of the piano and the pianist's fingers."""

from __future__ import annotations

import numpy as np

NUM_KEYS = 88
"""Keys of a full-size piano; key 0 is A0, key 87 is C8."""

MIN_PITCH = 21
"""MIDI pitch of key 0 (A0)."""

MAX_PITCH = MIN_PITCH + NUM_KEYS - 1
"""MIDI pitch of key 87 (C8): 108."""

PITCH_CLASS_IS_BLACK = np.isin(np.arange(12), (1, 3, 6, 8, 10))
"""(12,) bool, which pitch classes, from C, are black keys."""

KEY_IS_BLACK = PITCH_CLASS_IS_BLACK[(MIN_PITCH + np.arange(NUM_KEYS)) % 12]
"""(88,) bool, which keys are black."""

FINGERS_PER_HAND = 5

THUMB, INDEX, MIDDLE, RING, LITTLE = range(FINGERS_PER_HAND)

NUM_FINGERS = 2 * FINGERS_PER_HAND
"""Fingers 0-4 are the right hand, thumb to little; 5-9 the left hand, thumb to little."""

UNKNOWN_FINGER = -1
"""The label of a note without a chosen finger."""

FINGER_NAMES = tuple(
    f"{hand} {finger}"
    for hand in ("right", "left")
    for finger in ("thumb", "index", "middle", "ring", "little")
)
"""Names of fingers 0-9, in order."""

DEFAULT_VELOCITY = 80
"""MIDI velocity (1-127) of a note that does not say how hard it is struck.

Source: the value in RoboPianist's generated studies.
"""
