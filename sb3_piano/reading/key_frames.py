"""Targets of a hand's fingertips, state by state, m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.music.constants import FINGERS_PER_HAND, KEY_IS_BLACK
from sb3_piano.music.fingering.robot import hand_place
from sb3_piano.reading.keyboard import KeyPlaces, press_x
from sb3_piano.reading.presses import TimedPress

HOVER = 0.010
"""Height over a key of a finger that will soon play it, m."""
HOLD_DEPTH = 1.05
"""Depth of a key while it is down, a share of its travel."""

# What may replace what: a finger that lets go a key has the right of way over its next approach.
_HOVER, _LIFT, _READY, _RELEASE, _HOLD = range(1, 6)

_HOVER_STATES = 8  # for so many states a finger hovers over its next key
_REACH = 0.06  # distance of a hand from a key within which a finger already moves towards it, m

# Depths of a key: two states before it is down; in the state before, well on its way but not yet
# sounding; in the state before after a leap, when there is less time; between two strikes of it by
# the same finger, if there is no more time; in the state after; there, if the hand moves elsewhere.
_LIFT_DEPTH, _READY_DEPTH, _LEAP_READY_DEPTH = -0.5, 0.6, -0.2
_REPEAT_DEPTH, _RELEASE_DEPTH, _LEAP_RELEASE_DEPTH = 0.45, 0.2, -1.2

# Weights along x, y and z, per m, when a rad of posture counts some 0.01. From a black key a finger
# slips off; and with less along z a thumb is planned some 3 mm too high to press its key down.
_WEIGHT, _WEIGHT_BLACK = np.array([4.0, 10.0, 20.0]), np.array([20.0, 10.0, 20.0])

# How much each of the targets counts, as shares of these.
_READY_SHARE = 0.8
_LIFT_SHARE = 0.6
_LEAST_HOVER_SHARE = 0.1
_RELEASE_SHARE = np.array([0.1, 1.0, 0.8])
_LEAP_RELEASE_SHARE = np.array([0.1, 0.5, 0.8])

# Notes of the other colour so few states away make a passage mixed.
_MIXED_STATES = 3


@dataclass(frozen=True, eq=False)
class KeyFrames:
    """Targets of five fingertips over s states; state 0 is the start."""

    target: FloatArray
    """(s, 5, 3) places, m."""
    weight: FloatArray
    """(s, 5, 3) how much they count, per m; 0 where a finger has nothing to do."""
    on_black: BoolArray
    """(s, 5) which fingers are about to press a black key, or do."""

    to_black: BoolArray
    """(s, 5) which fingers are on their way to one, or from it."""

    def between(self, start: int, stop: int) -> KeyFrames:
        """Return those of some states."""
        part = slice(start, stop)
        return KeyFrames(
            self.target[part], self.weight[part], self.on_black[part], self.to_black[part]
        )


def key_frames(
    timed: Sequence[TimedPress],
    sign: int,
    n_states: int,
    radius: FloatArray,
    keys: KeyPlaces,
    hover: float = HOVER,
    hold_depth: float = HOLD_DEPTH,
) -> KeyFrames:
    """Return what a hand's presses ask of its fingertips.

    Args:
        timed: The presses, in order of time.
        sign: 1 for the right hand, -1 for the left one.
        n_states: How many states there are.
        radius: (5,) radius of the fingertips, m.
        keys: The keyboard.
        hover: Height over a key of a finger that will soon play it, m.
        hold_depth: Depth of a key while it is down, a share of its travel.
    """
    arrays = _FrameArrays(n_states)
    held = _held_places(timed, sign, n_states)
    mixed = _mixed(timed)
    last = [0] * FINGERS_PER_HAND  # until when each finger holds its note before
    for index, one in enumerate(timed):
        finger = one.press.finger
        place = hand_place(one.press.key, finger, sign)
        x = press_x(one.press.key, finger, mixed[index])
        goal = _Goal(one, x, float(radius[finger]), keys, hover, hold_depth)
        start = max(last[finger] + 2, one.first - _HOVER_STATES)
        free = {
            state: _is_free(held[state], finger, place)
            for state in range(max(start, 0), min(one.first - 1, n_states))
        }
        goal.write(arrays, start, free)
        last[finger] = max(last[finger], one.last)
    return KeyFrames(arrays.target, arrays.weight, arrays.on_black, arrays.to_black)


class _FrameArrays:
    """Arrays of targets while they are filled."""

    def __init__(self, n_states: int):
        self.n_states = n_states
        self.target = np.zeros((n_states, FINGERS_PER_HAND, 3))
        self.weight = np.zeros((n_states, FINGERS_PER_HAND, 3))
        self.on_black = np.zeros((n_states, FINGERS_PER_HAND), dtype=bool)
        self.to_black = np.zeros((n_states, FINGERS_PER_HAND), dtype=bool)
        self._rank = np.zeros((n_states, FINGERS_PER_HAND), dtype=int)

    def put(
        self, state: int, finger: int, rank: int, target: FloatArray, weight: FloatArray
    ) -> None:
        """Write a target, unless something more important is there."""
        if 0 < state < self.n_states and rank >= self._rank[state, finger]:
            self.target[state, finger] = target
            self.weight[state, finger] = weight
            self._rank[state, finger] = rank


@dataclass(frozen=True)
class _Goal:
    """One press, and how a finger comes to it and leaves it."""

    one: TimedPress
    x: float
    radius: float
    keys: KeyPlaces
    hover: float
    hold_depth: float

    def write(self, arrays: _FrameArrays, start: int, free: dict[int, bool]) -> None:
        """Write the targets, from state ``start`` on where the hand is near enough (``free``)."""
        one, finger = self.one, self.one.press.finger
        black = bool(KEY_IS_BLACK[one.press.key])
        full = _WEIGHT_BLACK if black else _WEIGHT
        strike = one.first - 1  # the state before the key is down
        for state in range(max(start, 0), strike - 1):
            near = 1 - (strike - state) / _HOVER_STATES
            share = max(_LEAST_HOVER_SHARE, near**3)
            if free.get(state, False):
                arrays.put(state, finger, _HOVER, self._at(0.0, self.hover), full * share)
        if free.get(strike - 1, False):
            place = self._at(_LIFT_DEPTH)
            arrays.put(strike - 1, finger, _LIFT, place, full * _LIFT_SHARE)
        ready = _LEAP_READY_DEPTH if one.leapt else _READY_DEPTH
        arrays.put(strike, finger, _READY, self._at(ready), full * _READY_SHARE)
        for state in range(one.first, one.last + 1):
            arrays.put(state, finger, _HOLD, self._at(self.hold_depth), full)
        depth = _LEAP_RELEASE_DEPTH if one.leaps else _RELEASE_DEPTH
        if one.repeated:
            depth = _REPEAT_DEPTH
        share_of = _LEAP_RELEASE_SHARE if one.leaps else _RELEASE_SHARE
        arrays.put(one.last + 1, finger, _RELEASE, self._at(depth), full * share_of)
        if black:
            arrays.to_black[max(one.first - _HOVER_STATES, 0) : one.last + 2, finger] = True
            arrays.on_black[max(strike, 0) : one.last + 1, finger] = True

    def _at(self, depth: float, above: float = 0.0) -> FloatArray:
        """Return where the fingertip is when the key is at a depth."""
        key = self.one.press.key
        height = self.keys.height(key, self.x, depth) + self.radius + above
        return np.array([self.x, self.keys.y[key], height])


def _held_places(
    timed: Sequence[TimedPress], sign: int, n_states: int
) -> list[list[tuple[int, float]]]:
    """Return for each state which fingers hold keys, and where that wants the hand to be."""
    held: list[list[tuple[int, float]]] = [[] for _ in range(n_states)]
    for one in timed:
        place = hand_place(one.press.key, one.press.finger, sign)
        for state in range(one.first, min(one.last + 1, n_states)):
            held[state].append((one.press.finger, place))
    return held


def _is_free(held: list[tuple[int, float]], finger: int, place: float) -> bool:
    """Return whether no other finger holds the hand too far away from a place."""
    return all(abs(place - there) <= _REACH for other, there in held if other != finger)


def _mixed(timed: Sequence[TimedPress]) -> list[bool]:
    """Return for each press whether its hand plays keys of the other colour about then."""
    first = np.array([one.press.first for one in timed], dtype=int)
    last = np.array([one.press.last for one in timed], dtype=int)
    black = np.array([bool(KEY_IS_BLACK[one.press.key]) for one in timed], dtype=bool)
    result = []
    for index in range(len(timed)):
        near = (first <= last[index] + _MIXED_STATES) & (last >= first[index] - _MIXED_STATES)
        result.append(bool((near & (black != black[index])).any()))
    return result
