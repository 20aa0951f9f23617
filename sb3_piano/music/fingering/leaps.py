"""Planned presses of a hand, shortened at its leaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

from sb3_piano.hands import HandSpec, find_hand
from sb3_piano.music.fingering.robot import (
    LEAP_REST,
    hand_place,
    is_leap,
    lost_to_leap,
    within_stretch,
)
from sb3_piano.music.presses import Press


@dataclass(frozen=True)
class TimedPress:
    """Press with its planned states."""

    press: Press
    """Press of the score."""
    first: int
    """First state in which the key must be down."""
    last: int
    """Last state in which the key must be down."""
    leaps: bool = False
    """Whether the hand leaps after it."""
    leapt: bool = False
    """Whether the hand leaps before it."""
    repeated: bool = False
    """Whether the same finger strikes the same key again right after it."""


def time_presses(
    presses: Sequence[Press],
    sign: int,
    stretch: float = 0.0,
    hurry: int = 0,
    robot: HandSpec | None = None,
    leave_early: int = 0,
    pedal: Sequence[bool] = (),
) -> tuple[TimedPress, ...]:
    """Shorten the presses of a hand at its leaps.

    A finger on a pressed key is in the gap between the neighbouring keys. It has to come up before
    it can move sideways, and the next finger has to arrive before it can go down. The earlier note
    ends early to give this time, but keeps at least one state; only missing time is taken from the
    start of the later note, because late strikes are heard more than early releases. If the leaps
    before and after a note would take all of it, its first and last state are swapped: it keeps two
    or more states, up to the whole note.

    Args:
        presses: The presses, in order of time.
        sign: 1 for the right hand, -1 for the left hand.
        stretch: Share of two fingers' span within which the hand need not leap. If all keys struck
            at a time are so near to the ones before, no note is shortened.
        hurry: Control steps by which leaps are shorter than :func:`lost_to_leap`.
        robot: The hand; by default the default hand.
        leave_early: Control steps by which a leap begins earlier, as far as the pedal holds the
            note from then on to its end.
        pedal: Whether the pedal is down in each control step.
    """
    robot = robot or find_hand()
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    places = [hand_place(press.key, press.finger, sign) for press in presses]
    # Steps that the pedal has been down at each state, without a lift.
    down = list(accumulate(pedal, lambda steps, is_down: (steps + 1) * is_down, initial=0))
    leaps: list[tuple[int, int, float]] = []
    moving = set()  # first states of presses to which the hand leaps
    for later, earlier in _neighbours(presses):
        before, after = presses[earlier], presses[later]
        same_finger = before.finger == after.finger
        distance = abs(places[later] - places[earlier])
        if same_finger and before.key == after.key:
            rest = after.first - before.last - 1
            timed[earlier] = replace(timed[earlier], repeated=rest <= 1)
        elif is_leap(distance, same_finger):
            leaps.append((later, earlier, distance))
            if not within_stretch(before, after, sign, stretch, robot):
                moving.add(after.first)
    for later, earlier, distance in leaps:
        before, after = presses[earlier], presses[later]
        if after.first in moving:
            lost = sum(lost_to_leap(distance, after.first - before.last - 1))
            lost = max(lost - hurry, 0)
            early = min(lost, before.last - before.first)
            late = min(lost - early, after.last - after.first)
            if leave_early:
                most = min(down[before.last], before.last - timed[earlier].first)
                early = max(early, min(lost + leave_early, most))
            first = max(timed[later].first, after.first + late)
            last = min(timed[earlier].last, before.last - early)
            timed[later] = replace(timed[later], leapt=True, first=first)
            timed[earlier] = replace(timed[earlier], leaps=True, last=last)
    # If leaps take the whole note from both ends, first and last are swapped.
    return tuple(
        replace(one, first=min(one.first, one.last), last=max(one.first, one.last)) for one in timed
    )


def _neighbours(presses: Sequence[Press]) -> list[tuple[int, int]]:
    """Find pairs (later, earlier) of notes between which the hand strikes no other note."""
    pairs: list[tuple[int, int]] = []
    recent: list[int] = []
    before = onset = 0  # the last two times at which the hand strikes
    for later, press in enumerate(presses):
        if press.first > onset:
            before, onset = onset, press.first
        recent = [i for i in recent if onset - presses[i].last - 1 <= LEAP_REST]
        pairs += [(later, i) for i in recent if before <= presses[i].last < onset]
        recent.append(later)
    return pairs
