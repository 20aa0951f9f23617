"""Presses of a hand as they are planned: shortened where it has to leap."""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    """A press as it is planned."""

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


def time_presses(
    presses: Sequence[Press],
    sign: int,
    stretch: float = 0.0,
    hurry: int = 0,
    robot: HandSpec | None = None,
) -> tuple[TimedPress, ...]:
    """Return the presses of a hand, shortened around its leaps.

    A finger that is pressed down stands in the gap between the neighbouring keys: it has to come
    up before it can move sideways, and the next one has to arrive before it can go down. The time
    for that is taken from the end of the earlier note, all but one state of it, and only what is
    then missing from the beginning of the later one: a strike that comes late is heard, a note
    that ends early hardly. Where the leaps before and after a note would take all of it, its first
    and its last state change places: it keeps two or more, up to the whole note.

    Args:
        presses: The presses, in order of time.
        sign: 1 for the right hand, -1 for the left one.
        stretch: Share of what two fingers can spread within which the hand does not have to leap:
            where all that is struck at a time is so near to what came before, nothing is lost.
        hurry: Control steps by which leaps cost less than :func:`lost_to_leap` says.
        robot: The hand, by default the default one.
    """
    robot = robot or find_hand()
    timed = [TimedPress(press, press.first, press.last) for press in presses]
    places = [hand_place(press.key, press.finger, sign) for press in presses]
    leaps: list[tuple[int, int, float]] = []
    for later, earlier in _neighbours(presses):
        before, after = presses[earlier], presses[later]
        same_finger = before.finger == after.finger
        distance = abs(places[later] - places[earlier])
        if same_finger and before.key == after.key:
            rest = after.first - before.last - 1
            timed[earlier] = replace(timed[earlier], repeated=rest <= 1)
        elif is_leap(distance, same_finger):
            leaps.append((later, earlier, distance))
    moving = {
        presses[later].first
        for later, earlier, _ in leaps
        if not within_stretch(presses[earlier], presses[later], sign, stretch, robot)
    }
    for later, earlier, distance in leaps:
        before, after = presses[earlier], presses[later]
        if after.first in moving:
            lost = sum(lost_to_leap(distance, after.first - before.last - 1))
            lost = max(lost - hurry, 0)
            early = min(lost, before.last - before.first)
            late = min(lost - early, after.last - after.first)
            first = max(timed[later].first, after.first + late)
            last = min(timed[earlier].last, before.last - early)
            timed[later] = replace(timed[later], leapt=True, first=first)
            timed[earlier] = replace(timed[earlier], leaps=True, last=last)
    # What leaps take from both ends may be all there is: then first and last change places.
    return tuple(
        replace(one, first=min(one.first, one.last), last=max(one.first, one.last)) for one in timed
    )


def _neighbours(presses: Sequence[Press]) -> list[tuple[int, int]]:
    """Return pairs (later, earlier) of notes between whose sounding the hand strikes no other."""
    onsets = sorted({press.first for press in presses})
    pairs = []
    recent: list[int] = []
    for later, press in enumerate(presses):
        recent = [i for i in recent if press.first - presses[i].last - 1 <= LEAP_REST]
        strikes = bisect.bisect_left(onsets, press.first)
        for earlier in recent:
            end = presses[earlier].last
            if end < press.first and bisect.bisect_right(onsets, end) >= strikes:
                pairs.append((later, earlier))
        recent.append(later)
    return pairs
