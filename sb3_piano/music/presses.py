"""Key presses with their fingers, from state to state of the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, IntArray
from sb3_piano.music.constants import FINGERS_PER_HAND, NUM_FINGERS, UNKNOWN_FINGER
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


def finger_goals(roll: PianoRoll, horizon: int) -> tuple[IntArray, IntArray, IntArray]:
    """Find the present or next note of each of ten fingers in T control steps.

    If labels give one finger several keys at once, its goal is the lowest.

    Returns:
        (T, 10) key to press, -1 if the finger has no note within the horizon; (T, 10) control steps
        until the key must be down (0: now), and (T, 10) until it must be up again, at most the
        horizon.
    """
    held, steps = _held_keys(roll), np.arange(len(roll))[:, None]
    # A repeated key is silent for a step before the strike. Every note ends at the last step.
    ends = (held >= 0) & (np.diff(held, axis=0, append=-2) != 0)
    onset, release = steps_until(held >= 0, horizon), steps_until(ends, horizon) + 1
    key = np.take_along_axis(held, np.minimum(steps + onset, len(roll) - 1), axis=0)
    seen = onset <= horizon
    release = np.where(seen, np.minimum(release, horizon), horizon)
    return np.where(seen, key, -1), np.where(seen, onset, horizon), release


def steps_until(events: BoolArray, horizon: int) -> IntArray:
    """Count the steps to each column's next event, (T, n); more than the horizon if it has none."""
    steps = np.arange(len(events))[:, None]
    at = np.where(events, steps, len(events) + horizon)
    return np.minimum.accumulate(at[::-1])[::-1] - steps


def _held_keys(roll: PianoRoll) -> IntArray:
    """Return the key that each finger holds, (T, 10), or -1."""
    held = np.full((len(roll), NUM_FINGERS), -1, dtype=np.intp)
    # From the highest key to the lowest, so that the lowest overwrites the others.
    steps, keys = (found[::-1] for found in np.nonzero(roll.active & (roll.finger >= 0)))
    held[steps, roll.finger[steps, keys]] = keys
    return held
