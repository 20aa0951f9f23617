"""Time for the hand to get from one note to the next."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass

from sb3_piano.planning.key_places import KeyPlaces
from sb3_piano.planning.presses import Press
from sb3_piano.planning.settings import PlanSettings

MIDDLE_FINGER = 2


@dataclass(frozen=True)
class PressAdjustment:
    """Deviation of a press from the settings, found by rehearsals."""

    ready: float = 0.0
    """Added to the depth in the state before the key is down."""
    firmness: float = 1.0
    """Times the force on the key."""
    along: float = 0.0
    """Farther from the hinge by so much, m."""
    across: float = 0.0
    """Farther to the right by so much, m."""


@dataclass
class TimedPress:
    """A press as it is planned: shortened where the hand has to leap."""

    press: Press
    """The press of the score."""
    first: int
    """First state in which the key is to be down."""
    last: int
    """Last one."""
    leaps: bool = False
    """Whether the hand leaves for another place after it."""
    leapt: bool = False
    """Whether it came from another place."""
    repeated: bool = False
    """Whether the same finger strikes the same key again right after it."""
    adjustment: PressAdjustment = PressAdjustment()
    """Its deviation from the settings."""


def hand_place(key: int, finger: int, sign: int, keys: KeyPlaces) -> float:
    """Return where the middle finger would be if the fingers lay on neighbouring white keys, m.

    Args:
        key: A key, 0 to 87, ...
        finger: ... and the finger on it, from 0, the thumb, to 4.
        sign: 1 for the right hand, -1 for the left one.
        keys: The keyboard.
    """
    return float(keys.y[key] - sign * (finger - MIDDLE_FINGER) * keys.spacing)


def is_leap(distance: float, same_finger: bool, settings: PlanSettings) -> bool:
    """Return whether the hand has to come up between two notes on different keys.

    Args:
        distance: How far apart it is for them, m.
        same_finger: Whether one finger plays both.
        settings: The plan's constants.
    """
    return same_finger or distance > settings.leap_distance


def lost_to_leap(distance: float, rest: int, settings: PlanSettings) -> tuple[int, int]:
    """Return by how many control steps the later note begins late, and the earlier one ends early.

    Args:
        distance: How far the hand has to go, m.
        rest: Control steps between the two notes.
        settings: The plan's constants.
    """
    steps = settings.leap_frames + sum(distance > more for more in settings.leap_more) - rest
    late = max(steps + 1, 0) // 2
    return late, max(steps, 0) - late


def time_presses(
    presses: Sequence[Press], sign: int, keys: KeyPlaces, settings: PlanSettings
) -> list[TimedPress]:
    """Return the presses of a hand, shortened around its leaps.

    A finger that is pressed down stands in the gap between the neighbouring keys: it has to come
    up before it can move sideways, and the next one has to arrive before it can go down. Half of
    the time for that is taken from the beginning of the later note, the rest from the end of the
    earlier one.

    Args:
        presses: What the hand plays, in order of time.
        sign: 1 for the right hand, -1 for the left one.
        keys: The keyboard.
        settings: The plan's constants.
    """
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    places = [hand_place(press.key, press.finger, sign, keys) for press in presses]
    for later, earlier in _neighbours(presses, settings.leap_rest):
        before, after = timed[earlier], timed[later]
        distance = abs(places[earlier] - places[later])
        rest = after.press.first - before.press.last - 1
        same_finger = before.press.finger == after.press.finger
        if same_finger and before.press.key == after.press.key:
            before.repeated = rest <= 1
            continue
        if not is_leap(distance, same_finger, settings):
            continue
        before.leaps = after.leapt = True
        late, early = lost_to_leap(distance, rest, settings)
        if late == 0:
            continue
        after.first = max(after.first, min(after.press.first + late, after.press.last))
        before.last = min(before.last, max(before.press.last - early, before.press.first))
    for one in timed:  # a very short note keeps one state
        one.first, one.last = min(one.first, one.last), max(one.first, one.last)
    return timed


def _neighbours(presses: Sequence[Press], longest_rest: int) -> list[tuple[int, int]]:
    """Return pairs (later, earlier) of notes between whose sounding the hand strikes no other."""
    onsets = sorted({press.first for press in presses})
    pairs = []
    recent: list[int] = []
    for later, press in enumerate(presses):
        recent = [i for i in recent if press.first - presses[i].last - 1 <= longest_rest]
        for earlier in recent:
            before = presses[earlier]
            if before.last < press.first and not _any_between(onsets, before.last, press.first):
                pairs.append((later, earlier))
        recent.append(later)
    return pairs


def _any_between(onsets: list[int], low: int, high: int) -> bool:
    """Return whether a note begins after ``low`` and before ``high``."""
    return bisect.bisect_right(onsets, low) < bisect.bisect_left(onsets, high)
