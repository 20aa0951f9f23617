"""What a fingering costs, in tables: one key at a time, two in succession, three in succession.

Everything here is the right hand's: the left hand is its mirror image, and so are its keys. The
keyboard is its own mirror image about D, so that the mirrored keys keep their colours.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sb3_piano.music.constants import (
    FINGERS_PER_HAND,
    LITTLE,
    MIDDLE,
    PITCH_CLASS_IS_BLACK,
    RING,
    THUMB,
)
from sb3_piano.music.fingering.weights import FingeringWeights, Reach

Table = NDArray[np.float64]

MAX_INTERVAL = 87

_OCTAVE_WIDTH = 12.0
_WHITE_WIDTH = _OCTAVE_WIDTH / 7


def key_positions(physical: float) -> Table:
    """Return where the keys of an octave from C are, in semitones: (12,).

    Args:
        physical: Share of the place on a real keyboard, in [0, 1]; the rest is the pitch.
    """
    white = [(index + 0.5) * _WHITE_WIDTH for index in range(7)]
    # Behind the black keys the octave is cut into five and seven nearly equal strips.
    strips = [(index + 0.5) * 3 * _WHITE_WIDTH / 5 for index in range(5)]
    strips += [3 * _WHITE_WIDTH + (index + 0.5) * 4 * _WHITE_WIDTH / 7 for index in range(7)]
    places = np.where(PITCH_CLASS_IS_BLACK, strips, white_places(white))
    pitches = np.arange(12) + 0.5
    return physical * places + (1 - physical) * pitches


def white_places(white: list[float]) -> Table:
    """Spread the places of seven white keys over the twelve keys of an octave."""
    order = np.cumsum(~PITCH_CLASS_IS_BLACK) - 1
    return np.array(white)[order]


class CostTables:
    """The rules of one set of weights, worked out for all keys and fingers.

    Fingers are 0 (thumb) to 4, keys a pitch class of the first (0 is C) and an interval in
    semitones, shifted by `MAX_INTERVAL`.

    Attributes:
        single: (2, 5), for a white or black key and its finger.
        moves: (12, 175, 5, 5), for two keys in succession; counts more the faster they follow.
        chord_moves: (12, 175, 5, 5), the same from or to a chord.
        colours: (12, 175, 5, 5), for the colours of two keys in succession.
        grips: (12, 175, 5, 5), for two keys that are down together.
        far: (12, 175, 5, 5), whether two keys cannot be held together by these fingers.
        shifts: (12, 175, 5, 5), for the first and third of three keys in succession.
        full_shifts: (12, 175, 5, 5), for the same if the thumb has the second key, between them.
        triples: (5, 5, 5), for the fingers of three keys in succession.
    """

    def __init__(self, weights: FingeringWeights) -> None:
        """Work the tables out."""
        self.weights = weights
        distance = _distances(weights.physical)
        first, second = _colours()
        self.single = np.zeros((2, FINGERS_PER_HAND))
        shape = (12, 2 * MAX_INTERVAL + 1, FINGERS_PER_HAND, FINGERS_PER_HAND)
        self.moves, self.chord_moves, self.colours, self.grips = np.zeros((4, *shape))
        self.shifts, self.full_shifts = np.zeros((2, *shape))
        self.far = np.zeros(shape, dtype=bool)
        for one in range(FINGERS_PER_HAND):
            for other in range(FINGERS_PER_HAND):
                at = (..., one, other)
                passing = _passing(weights, one, other, distance, first, second)
                same = weights.same_finger, weights.same_finger_size
                self.moves[at] = _move(weights, one, other, distance, same) + passing
                same = weights.chord_finger, weights.chord_finger_size
                self.chord_moves[at] = _move(weights, one, other, distance, same) + passing
                self.colours[at] = _colour(weights, one, other, first, second)
                self.far[at] = _far(weights, one, other, distance)
                self.grips[at] = _grip(weights, one, other, distance)
                self.shifts[at], self.full_shifts[at] = _shift(weights, one, other, distance)
        self.single[:, RING] += weights.weak_four
        self.single[:, LITTLE] += weights.weak_five
        self.single[1, THUMB] += weights.thumb_on_black
        self.single[1, LITTLE] += weights.five_on_black
        self.triples = _triples(weights)


@lru_cache(maxsize=8)
def cost_tables(weights: FingeringWeights) -> CostTables:
    """Return the tables of `weights`, which take a moment to work out, once."""
    return CostTables(weights)


def _distances(physical: float) -> Table:
    """(12, 175): how far the second key is above the first, in semitones."""
    second = np.arange(12)[:, None] + np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1)
    places = key_positions(physical)
    return places[second % 12] + _OCTAVE_WIDTH * (second // 12) - places[:, None]


def _colours() -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(12, 175) each: whether the first and whether the second key is black."""
    second = np.arange(12)[:, None] + np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1)
    black = PITCH_CLASS_IS_BLACK[second % 12]
    return np.broadcast_to(PITCH_CLASS_IS_BLACK[:, None], black.shape), black


def _reach(weights: FingeringWeights, one: int, other: int) -> Reach:
    return weights.reaches[min(one, other) + 1, max(one, other) + 1]


def _beyond(distance: Table, low: float, high: float) -> Table:
    return np.maximum(low - distance, 0) + np.maximum(distance - high, 0)


def _strain(weights: FingeringWeights, one: int, other: int, distance: Table) -> Table:
    """Count stretch, small span, large span and what is impractical, for two fingers."""
    reach = _reach(weights, one, other)
    up = distance if one < other else -distance
    thumb = THUMB in (one, other)
    return (
        weights.stretch * _beyond(up, reach.min_comfortable, reach.max_comfortable)
        + (weights.span_thumb if thumb else weights.span_fingers)
        * _beyond(up, reach.min_relaxed, reach.max_relaxed)
        + weights.impractical * _beyond(up, reach.min_practical, reach.max_practical)
    )


def _limited(cost: Table, most: float) -> Table:
    """Let costs grow ever more slowly towards `most`: of far keys none is nearer to a finger."""
    return cost * most / (cost + most)


def _move(
    weights: FingeringWeights, one: int, other: int, distance: Table, same: tuple[float, float]
) -> Table:
    change = weights.place * _displacement(one, other, distance)
    if one == other:
        cost = same[0] + same[1] * np.abs(distance) + change
        return np.where(distance == 0, 0.0, _limited(cost, weights.leap))
    cost = _limited(_strain(weights, one, other, distance) + change, weights.leap)
    return np.where(distance == 0, weights.other_finger, cost)


def _displacement(one: int, other: int, distance: Table) -> Table:
    """How far the hand's place moves, in semitones."""
    return np.asarray(np.abs(distance - (other - one) * _WHITE_WIDTH))


def _passing(
    weights: FingeringWeights,
    one: int,
    other: int,
    distance: Table,
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
) -> Table:
    if one == other or THUMB not in (one, other):
        return np.zeros_like(distance)
    thumb, finger, up = (first, second, distance) if one == THUMB else (second, first, -distance)
    level = np.where(thumb == finger, weights.passing, 0.0)
    cost = np.where(thumb & ~finger, weights.passing_on_black, level)
    semitones = np.abs(np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1))
    # Limited, since far keys are reached with a leap, and nothing passes.
    size = weights.passing_size * np.minimum(semitones, _OCTAVE_WIDTH)
    return np.where(up < 0, cost + size, 0.0)


def _colour(
    weights: FingeringWeights,
    one: int,
    other: int,
    first: NDArray[np.bool_],
    second: NDArray[np.bool_],
) -> Table:
    cost = np.zeros(first.shape)
    if (one, other) == (MIDDLE, RING):
        cost += weights.three_to_four + weights.four_on_black * (~first & second)
    if (one, other) == (RING, MIDDLE):
        cost += weights.four_on_black * (first & ~second)
    for finger, extra in (
        (THUMB, weights.thumb_on_black_white),
        (LITTLE, weights.five_on_black_white),
    ):
        if one == finger != other:
            cost += extra * (first & ~second)
        if other == finger != one:
            cost += extra * (~first & second)
    return cost


def _grip(weights: FingeringWeights, one: int, other: int, distance: Table) -> Table:
    if one == other:
        return np.full_like(distance, weights.leap)
    change = weights.place * _displacement(one, other, distance)
    return weights.chord * _limited(_strain(weights, one, other, distance) + change, weights.leap)


def _far(weights: FingeringWeights, one: int, other: int, distance: Table) -> NDArray[np.bool_]:
    if one == other:
        return np.ones(distance.shape, dtype=bool)
    reach = _reach(weights, one, other)
    up = distance if one < other else -distance
    return _beyond(up, reach.min_practical, reach.max_practical) > 0


def _shift(weights: FingeringWeights, one: int, other: int, distance: Table) -> tuple[Table, Table]:
    change = weights.place_later * _displacement(one, other, distance)
    if one == other:
        size = np.abs(distance)
        cost = weights.position_count * (size > 0) + weights.position_size * size + change
        return (_limited(cost, weights.leap),) * 2
    reach = _reach(weights, one, other)
    up = distance if one < other else -distance
    size = _beyond(up, reach.min_comfortable, reach.max_comfortable)
    half = weights.position_count * (size > 0) + weights.position_size * size + change
    full = half + weights.position_count * (
        _beyond(up, reach.min_practical, reach.max_practical) > 0
    )
    later = weights.other_finger_later * (distance == 0)
    return _limited(half, weights.leap) + later, _limited(full, weights.leap) + later


def _triples(weights: FingeringWeights) -> Table:
    table = np.zeros((FINGERS_PER_HAND,) * 3)
    for fingers in np.ndindex(table.shape):
        if sorted(fingers) == [MIDDLE, RING, LITTLE]:
            table[fingers] = weights.three_four_five
    return table
