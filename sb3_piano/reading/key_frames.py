"""Targets of a hand's fingertips, state by state, m."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.music.constants import KEY_IS_BLACK
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
    """Targets of a hand's f fingertips over s states; state 0 is the start."""

    target: FloatArray
    """(s, f, 3) places, m."""
    weight: FloatArray
    """(s, f, 3) how much they count, per m; 0 where a finger has nothing to do."""
    on_black: BoolArray
    """(s, f) which fingers are about to press a black key, or do."""

    to_black: BoolArray
    """(s, f) which fingers are on their way to one, or from it."""

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
        radius: (f,) radius of the fingertips, m.
        keys: The keyboard.
        hover: Height over a key of a finger that will soon play it, m.
        hold_depth: Depth of a key while it is down, a share of its travel.
    """
    shape = (n_states, len(radius))
    frames = KeyFrames(
        target=np.zeros((*shape, 3)),
        weight=np.zeros((*shape, 3)),
        on_black=np.zeros(shape, dtype=bool),
        to_black=np.zeros(shape, dtype=bool),
    )
    rank = np.zeros(shape, dtype=int)
    places = [hand_place(one.press.key, one.press.finger, sign) for one in timed]
    # In each state, the fingers that hold keys, and where that wants the hand to be.
    held: list[list[tuple[int, float]]] = [[] for _ in range(n_states)]
    for one, place in zip(timed, places, strict=True):
        for state in range(one.first, min(one.last + 1, n_states)):
            held[state].append((one.press.finger, place))
    last = [0] * len(radius)  # until when each finger holds its note before
    for one, place, mixed in zip(timed, places, _mixed(timed), strict=True):
        key, finger = one.press.key, one.press.finger
        start = max(last[finger] + 2, one.first - _HOVER_STATES, 0)
        last[finger] = max(last[finger], one.last)
        free = [  # where no other finger holds the hand too far away
            state
            for state in range(start, min(one.first - 1, n_states))
            if all(abs(place - at) <= _REACH for other, at in held[state] if other != finger)
        ]
        x = press_x(key, finger, mixed)
        full = _WEIGHT_BLACK if KEY_IS_BLACK[key] else _WEIGHT
        for state, level, depth, above, share in _targets(one, free, hover, hold_depth):
            if 0 < state < n_states and level >= rank[state, finger]:
                height = keys.height(key, x, depth) + float(radius[finger]) + above
                frames.target[state, finger] = x, keys.y[key], height
                frames.weight[state, finger] = full * share
                rank[state, finger] = level
        if KEY_IS_BLACK[key]:
            frames.to_black[max(one.first - _HOVER_STATES, 0) : one.last + 2, finger] = True
            frames.on_black[max(one.first - 1, 0) : one.last + 1, finger] = True
    return frames


def _targets(
    one: TimedPress, free: Sequence[int], hover: float, hold_depth: float
) -> Iterator[tuple[int, int, float, float, FloatArray | float]]:
    """Yield how a finger comes to its key and leaves it, as far as the hand is near (``free``).

    Yields:
        State, rank, depth of the key, height over that, m, and how much it counts.
    """
    strike = one.first - 1  # the state before the key is down
    for state in free:
        if state < strike - 1:
            near = 1 - (strike - state) / _HOVER_STATES
            yield state, _HOVER, 0.0, hover, max(_LEAST_HOVER_SHARE, near**3)
        else:
            yield state, _LIFT, _LIFT_DEPTH, 0.0, _LIFT_SHARE
    yield strike, _READY, _LEAP_READY_DEPTH if one.leapt else _READY_DEPTH, 0.0, _READY_SHARE
    for state in range(one.first, one.last + 1):
        yield state, _HOLD, hold_depth, 0.0, 1.0
    depth = _LEAP_RELEASE_DEPTH if one.leaps else _RELEASE_DEPTH
    share = _LEAP_RELEASE_SHARE if one.leaps else _RELEASE_SHARE
    yield one.last + 1, _RELEASE, _REPEAT_DEPTH if one.repeated else depth, 0.0, share


def _mixed(timed: Sequence[TimedPress]) -> list[bool]:
    """Return for each press whether its hand plays keys of the other colour about then."""
    first = np.array([one.press.first for one in timed], dtype=int)
    last = np.array([one.press.last for one in timed], dtype=int)
    black = np.array([bool(KEY_IS_BLACK[one.press.key]) for one in timed], dtype=bool)
    near = (first <= last[:, None] + _MIXED_STATES) & (last >= first[:, None] - _MIXED_STATES)
    return np.asarray((near & (black != black[:, None])).any(axis=1)).tolist()
