"""Fingers that suit this hand: some of a score's are changed.

A score's fingering is for people, whose thumbs pass under and whose hands stretch. The simulated
hand can do neither, and each shift of it costs sound. Of all ways to finger what a hand plays, the
one is taken by which the fewest control steps of sound are lost: those of notes that a grip does
not reach, and those that leaps take from the notes around them. What is written stays, unless a
change brings more than :attr:`PlanSettings.change_finger` a note, or a finger would have to hold
two keys while others are free. What no fingers can hold is let go: see
:mod:`sb3_piano.planning.grips`.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sb3_piano.music import PianoRoll
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.hands import FINGERS_PER_HAND
from sb3_piano.planning.grips import EarlyRelease, early_releases, out_of_reach
from sb3_piano.planning.key_places import THUMB, KeyPlaces
from sb3_piano.planning.leaps import hand_place, is_leap, lost_to_leap
from sb3_piano.planning.presses import Press, presses_of_hand
from sb3_piano.planning.settings import PlanSettings
from sb3_piano.simulation import KEY_IS_BLACK

_TOLERANCE = 0.010  # so far out of reach, a note is lost; m
_MOST_LOST = 2.0  # both notes of a grip
_CROSSED = 1000.0  # fingers that cross, in control steps
_REPEATED = 0.5  # a strike of the same key by the same finger
_LEAP_WEIGHT = 5.0  # the way of a leap, per m: the shorter one, if as much is lost
_PASSED = 2.0  # a finger, not the thumb, that passes another one
_KEPT = 40  # ways that are followed at the same time

_Assignment = tuple[tuple[int, int], ...]
"""Which of the presses that sound, or have just sounded, have which fingers."""


@dataclass(frozen=True)
class Fitted:
    """A piece as the hands can hold it."""

    roll: PianoRoll
    """With the fingers that play, and none from where on a note is released early."""
    early_releases: tuple[list[EarlyRelease], list[EarlyRelease]]
    """Notes that the right and the left hand do not hold to their end."""


def fit_fingers(roll: PianoRoll, keys: KeyPlaces, settings: PlanSettings) -> Fitted:
    """Find fingers that suit the hands.

    Args:
        roll: The piece, with fingers. Each note stays with its hand.
        keys: The keyboard.
        settings: The plan's constants.
    """
    label = roll.finger.copy()
    releases = []
    for hand, sign in ((0, 1), (1, -1)):
        presses = presses_of_hand(roll, hand)
        for press in presses:
            label[_steps(press)] = UNKNOWN_FINGER
        kept, fingers, hand_releases = _fit_hand(presses, sign, keys, settings)
        for press, finger in zip(kept, fingers, strict=True):
            label[_steps(press)] = hand * FINGERS_PER_HAND + finger
        releases.append(hand_releases)
    right, left = releases
    return Fitted(dataclasses.replace(roll, finger=label), (right, left))


def _steps(press: Press) -> tuple[slice, int]:
    """Return which control steps of a roll a press is, and its key."""
    return slice(press.first - 1, press.last), press.key


def _fit_hand(
    presses: list[Press], sign: int, keys: KeyPlaces, settings: PlanSettings
) -> tuple[list[Press], list[int], list[EarlyRelease]]:
    """Return what a hand plays with which fingers, and what it releases early.

    Fingers are chosen anew for what is left, until all of it can be held.
    """
    releases: dict[tuple[int, int], EarlyRelease] = {}
    while True:
        fingers = choose(presses, sign, keys, settings)
        more = early_releases(presses, fingers, sign, keys)
        if not more:
            return presses, fingers, list(releases.values())
        for one in more:
            note = one.press.key, one.press.first
            releases[note] = (
                dataclasses.replace(one, press=releases[note].press) if note in releases else one
            )
        shorter = (
            dataclasses.replace(press, last=releases[note].last)
            if (note := (press.key, press.first)) in releases
            else press
            for press in presses
        )
        presses = [press for press in shorter if press.last >= press.first]


def choose(
    presses: Sequence[Press], sign: int, keys: KeyPlaces, settings: PlanSettings
) -> list[int]:
    """Return a finger, 0 to 4, for each press of a hand.

    Dynamic programming over the onsets: of all ways in which the same fingers hold the same keys,
    only the best so far goes on.

    Args:
        presses: What the hand plays, in order of time.
        sign: 1 for the right hand, -1 for the left one.
        keys: The keyboard.
        settings: The plan's constants.
    """
    costs = _Costs(presses, sign, keys, settings)
    onsets: dict[int, list[int]] = {}
    for index, press in enumerate(presses):
        onsets.setdefault(press.first, []).append(index)
    best: dict[_Assignment, float] = {(): 0.0}
    trail: list[dict[_Assignment, _Assignment]] = []
    for onset, struck in onsets.items():
        before = sorted(best, key=lambda way: best[way])[:_KEPT]
        onward: dict[_Assignment, float] = {}
        came: dict[_Assignment, _Assignment] = {}
        for way in before:
            for after, cost in costs.successors(way, onset, struck):
                if best[way] + cost < onward.get(after, np.inf):
                    onward[after], came[after] = best[way] + cost, way
        best = onward
        trail.append(came)
    chosen = dict.fromkeys(range(len(presses)), 0)
    way = min(best, key=lambda way: best[way])
    for came in reversed(trail):
        chosen.update(way)
        way = came[way]
    return [chosen[index] for index in range(len(presses))]


@dataclass(frozen=True)
class _Costs:
    """Costs of fingers on presses, in control steps of sound."""

    presses: Sequence[Press]
    sign: int
    """1 for the right hand, -1 for the left one."""
    keys: KeyPlaces
    settings: PlanSettings

    @functools.cached_property
    def across(self) -> list[float]:
        """Place of each press, from the thumb's side to the little finger's, m."""
        return [self.sign * float(self.keys.y[press.key]) for press in self.presses]

    def successors(
        self, way: _Assignment, onset: int, struck: list[int]
    ) -> Iterator[tuple[_Assignment, float]]:
        """Yield the ways in which some presses can be struck, and what each adds to the cost."""
        held = [(i, finger) for i, finger in way if self.presses[i].last >= onset]
        ended = [(i, finger) for i, finger in way if self.presses[i].last < onset]
        struck = sorted(struck, key=lambda i: self.across[i])
        taken = {finger for _, finger in held}
        free = [finger for finger in range(FINGERS_PER_HAND) if finger not in taken]
        for fingers in combinations(free, len(struck)):
            new = list(zip(struck, fingers, strict=True))
            yield (*held, *new), self._cost(held, ended, new)
        if len(struck) > len(free):  # more than the hand can do: as it is written
            yield (*held, *((i, self.presses[i].finger) for i in struck)), 0.0

    def _cost(
        self,
        held: list[tuple[int, int]],
        ended: list[tuple[int, int]],
        new: list[tuple[int, int]],
    ) -> float:
        cost = 0.0
        for number, (i, finger) in enumerate(new):
            press = self.presses[i]
            cost += self.settings.change_finger * (finger != press.finger)
            cost += self.settings.thumb_on_black * (finger == THUMB and KEY_IS_BLACK[press.key])
            cost += sum(self._grip(i, finger, *other) for other in (*held, *new[:number]))
        late, early = dict.fromkeys(new, 0.0), dict.fromkeys(ended, 0.0)
        for after in new:
            for before in ended:
                begins_late, ends_early = self._leap(before, after)
                late[after] = max(late[after], begins_late)
                early[before] = max(early[before], ends_early)
        return cost + sum(late.values()) + sum(early.values())

    def _grip(self, i: int, finger: int, j: int, other: int) -> float:
        """Return what it costs that two keys are held at the same time."""
        if (self.across[i], finger) > (self.across[j], other):
            i, finger, j, other = j, other, i, finger
        if finger >= other:
            return _CROSSED
        apart = self.across[j] - self.across[i]
        off = out_of_reach(apart, finger, other)
        one, two = self.presses[i], self.presses[j]
        together = max(min(one.last, two.last) - max(one.first, two.first) + 1, 1)
        return float(together * min(off / _TOLERANCE, _MOST_LOST))

    def _leap(self, before: tuple[int, int], after: tuple[int, int]) -> tuple[float, float]:
        """Return how late a note begins and how early the one before ends."""
        (i, finger), (j, other) = before, after
        rest = self.presses[j].first - self.presses[i].last - 1
        if rest > self.settings.leap_rest:
            return 0.0, 0.0
        if finger == other and self.presses[i].key == self.presses[j].key:
            return (_REPEATED if rest == 0 else 0.0), 0.0
        distance = abs(self._hand(i, finger) - self._hand(j, other))
        if not is_leap(distance, finger == other, self.settings):
            return 0.0, 0.0
        late, early = lost_to_leap(distance, rest, self.settings)
        upwards = self.across[j] > self.across[i]
        passes = THUMB not in (finger, other) and (other < finger if upwards else other > finger)
        return late + _LEAP_WEIGHT * distance + _PASSED * passes, early

    def _hand(self, i: int, finger: int) -> float:
        return hand_place(self.presses[i].key, finger, self.sign, self.keys)
