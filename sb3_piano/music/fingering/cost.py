"""Costs of a fingering: weights of its rules, and tables for one, two and three keys in a row.

Everything here is for the right hand: the left hand and its keys are mirrored. The keyboard is
symmetric about D, so mirrored keys keep their colours.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

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
from sb3_piano.settings import NotNegative, Positive, Share, settings

Table = NDArray[np.float64]

MAX_INTERVAL = 87

_OCTAVE_WIDTH = 12.0
_WHITE_WIDTH = _OCTAVE_WIDTH / 7


MEDIUM_HAND: Mapping[tuple[int, int], tuple[int, ...]] = MappingProxyType(
    {
        (1, 2): (-8, -6, 1, 5, 8, 10),
        (1, 3): (-7, -5, 3, 9, 12, 14),
        (1, 4): (-5, -3, 5, 11, 13, 15),
        (1, 5): (-2, 0, 7, 12, 14, 16),
        (2, 3): (1, 1, 1, 2, 5, 7),
        (2, 4): (1, 1, 3, 4, 6, 8),
        (2, 5): (2, 2, 5, 6, 10, 12),
        (3, 4): (1, 1, 1, 2, 2, 4),
        (3, 5): (1, 1, 3, 4, 6, 8),
        (4, 5): (1, 1, 1, 2, 4, 6),
    }
)
"""Limits of the distance from a finger of the right hand to a higher one, by pianists' numbers.

In semitones, upwards positive, negative with the thumb passed under the other finger: the
practical, comfortable and relaxed minimum, then the relaxed, comfortable and practical maximum.

Source: the medium hand of Balliauw, Herremans, Palhazi Cuervo and Sorensen 2017, "A variable
neighborhood search algorithm to generate piano fingerings for polyphonic sheet music", measured on
music with chords.
"""


@settings
class FingeringWeights:
    """The cost of each rule; the chosen fingering has the least total cost.

    Names in quotes are rules of Parncutt, Sloboda, Clarke, Raekallio and Desain 1997, "An ergonomic
    model of keyboard fingering for melodic fragments", whose points are the unit of all costs.
    Distances are in semitones, times in s. The values were tuned on the generated studies, in
    several runs of benchmarks/tune_fingering_weights.py, and rounded.
    """

    physical: Share = 0.48  # of mm in distances, the rest is semitones (Jacobs 2001)
    stretch: NotNegative = 2.52  # "stretch", per semitone beyond comfortable
    span_thumb: NotNegative = 0.93  # "small span", "large span" with the thumb, beyond relaxed
    span_fingers: NotNegative = 1.44  # the same without the thumb
    impractical: NotNegative = 10.0  # per semitone beyond practical (Balliauw et al. 2017)
    position_count: NotNegative = 1.23  # "position change count", of a half change; full: twice
    position_size: NotNegative = 0.71  # "position change size", per semitone beyond comfortable
    place: NotNegative = 0.3  # per semitone by which the thumb's place over white keys changes
    place_later: NotNegative = 0.28  # the same over two keys
    same_finger: NotNegative = 32.8  # one finger on two keys in succession (Balliauw et al. 2017)
    same_finger_size: NotNegative = 2.1  # the same, per semitone between the keys
    other_finger: NotNegative = 3.18  # another finger on the key that was struck last
    other_finger_later: NotNegative = 0.79  # the same with one other key in between
    leap: Positive = 22.4  # maximum cost of a movement between two keys
    weak_four: NotNegative = 0.55  # "weak finger", the ring finger
    weak_five: NotNegative = 0.67  # "weak finger", the little finger
    three_four_five: NotNegative = 0.23  # "three-four-five"
    three_to_four: NotNegative = 0.64  # "three-to-four"
    four_on_black: NotNegative = 0.83  # "four on black", the third finger on white beside it
    thumb_on_black: NotNegative = 6.79  # "thumb on black"
    thumb_on_black_white: NotNegative = 1.73  # the same, for each white key beside it
    five_on_black: NotNegative = 0.0  # "five on black"
    five_on_black_white: NotNegative = 6.18  # the same, for each white key beside it
    passing: NotNegative = 1.24  # "thumb passing", between keys of one colour
    passing_size: NotNegative = 0.43  # per semitone that a finger and the thumb pass each other by
    passing_on_black: NotNegative = 3.0  # "thumb passing", the thumb on black, the other on white
    chord_finger: NotNegative = 0.47  # as same_finger, from or to a chord
    chord_finger_size: NotNegative = 0.51  # as same_finger_size, from or to a chord
    chord_shift: NotNegative = 0.51  # share of position changes that counts with chords among them
    chord: NotNegative = 4.0  # how much the reach counts between keys that are down together
    pace: Positive = 0.25  # time between notes at which the costs of movement count fully
    haste: NotNegative = 0.5  # exponent with which they grow for faster notes
    rest: Positive = 0.6  # silence after which they are down to 1/e


DEFAULT_WEIGHTS = FingeringWeights()


def _key_positions(physical: float) -> Table:
    """Compute the positions of the keys of an octave from C, in semitones: (12,)."""
    white = np.array([(index + 0.5) * _WHITE_WIDTH for index in range(7)])
    # At the black keys the octave has five and seven nearly equal strips.
    strips = [(index + 0.5) * 3 * _WHITE_WIDTH / 5 for index in range(5)]
    strips += [3 * _WHITE_WIDTH + (index + 0.5) * 4 * _WHITE_WIDTH / 7 for index in range(7)]
    of_white = white[np.cumsum(~PITCH_CLASS_IS_BLACK) - 1]
    places = np.where(PITCH_CLASS_IS_BLACK, strips, of_white)
    return physical * places + (1 - physical) * (np.arange(12) + 0.5)


class CostTables:
    """The costs of all keys and fingers, precomputed for one set of weights.

    Fingers are 0 (thumb) to 4. Two keys are the pitch class of the first (0 is C) and an interval
    in semitones, shifted by `MAX_INTERVAL`.

    Attributes:
        single: (2, 5), for a white or black key and its finger.
        moves: (12, 175, 5, 5), for two keys in succession; weighted by their pace.
        chord_moves: (12, 175, 5, 5), the same from or to a chord.
        colours: (12, 175, 5, 5), for the colours of two keys in succession.
        grips: (12, 175, 5, 5), for two keys held together.
        far: (12, 175, 5, 5), whether two keys cannot be held together by these fingers.
        shifts: (12, 175, 5, 5), for the first and third of three keys in succession.
        full_shifts: (12, 175, 5, 5), for the same if the thumb plays the second key, between them.
        triples: (5, 5, 5), for the fingers of three keys in succession.
    """

    def __init__(
        self,
        weights: FingeringWeights,
        reaches: Mapping[tuple[int, int], tuple[int, ...]] = MEDIUM_HAND,
    ) -> None:
        """Compute the tables."""
        self.weights = w = weights
        pairs = _Pairs(w.physical, reaches)
        distance, same = pairs.distance, pairs.same
        change = w.place * pairs.displacement
        span = np.where(pairs.thumb, w.span_thumb, w.span_fingers)
        strain = w.stretch * pairs.beyond_comfortable + span * pairs.beyond_relaxed
        strained = self._limited(strain + w.impractical * pairs.beyond_practical + change)
        passing = self._passing(pairs)

        def moves(same_finger: float, size: float) -> Table:
            own = self._limited(same_finger + size * np.abs(distance) + change)
            own = np.where(distance == 0, 0.0, own)
            other = np.where(distance == 0, w.other_finger, strained)
            return np.where(same, own, other) + passing

        self.moves = moves(w.same_finger, w.same_finger_size)
        self.chord_moves = moves(w.chord_finger, w.chord_finger_size)
        self.colours = self._colours(pairs)
        self.grips = np.where(same, w.leap, w.chord * strained)
        self.far = same | (pairs.beyond_practical > 0)
        size = np.where(same, np.abs(distance), pairs.beyond_comfortable)
        change = w.place_later * pairs.displacement
        half = w.position_count * (size > 0) + w.position_size * size + change
        full = half + w.position_count * (~same & (pairs.beyond_practical > 0))
        later = w.other_finger_later * (~same & (distance == 0))
        self.shifts, self.full_shifts = self._limited(half) + later, self._limited(full) + later
        white = (0.0, 0.0, 0.0, w.weak_four, w.weak_five)
        black = (w.thumb_on_black, 0.0, 0.0, w.weak_four, w.weak_five + w.five_on_black)
        self.single = np.array([white, black])
        self.triples = np.zeros((FINGERS_PER_HAND,) * 3)
        for fingers in itertools.permutations((MIDDLE, RING, LITTLE)):
            self.triples[fingers] = w.three_four_five

    def _limited(self, cost: Table) -> Table:
        """Let costs saturate: far keys are equally far from every finger."""
        return cost * self.weights.leap / (cost + self.weights.leap)

    def _passing(self, pairs: _Pairs) -> Table:
        """Compute the costs of thumb and finger passing each other."""
        w = self.weights
        first = pairs.one == THUMB
        thumb = np.where(first, pairs.black, pairs.black_later)
        finger = np.where(first, pairs.black_later, pairs.black)
        level = np.where(thumb == finger, w.passing, 0.0)
        cost = np.where(thumb & ~finger, w.passing_on_black, level)
        semitones = np.abs(np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1))[:, None, None]
        # Limited, since the hand leaps to far keys without passing.
        size = w.passing_size * np.minimum(semitones, _OCTAVE_WIDTH)
        return np.where(pairs.thumb & ~pairs.same & (pairs.up < 0), cost + size, 0.0)

    def _colours(self, pairs: _Pairs) -> Table:
        """Compute the costs of the colours of two keys."""
        w = self.weights
        up, down = ~pairs.black & pairs.black_later, pairs.black & ~pairs.black_later
        cost = np.zeros(np.broadcast_shapes(up.shape, pairs.same.shape))
        cost[..., MIDDLE, RING] += w.three_to_four + w.four_on_black * up[..., 0, 0]
        cost[..., RING, MIDDLE] += w.four_on_black * down[..., 0, 0]
        for finger, extra in ((THUMB, w.thumb_on_black_white), (LITTLE, w.five_on_black_white)):
            cost += extra * (down & (pairs.one == finger) & ~pairs.same)
            cost += extra * (up & (pairs.other == finger) & ~pairs.same)
        return cost


class _Pairs:
    """Two keys with two fingers, in arrays that broadcast to (12, 175, 5, 5)."""

    def __init__(self, physical: float, reaches: Mapping[tuple[int, int], tuple[int, ...]]) -> None:
        second = np.arange(12)[:, None] + np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1)
        places = _key_positions(physical)
        distance = places[second % 12] + _OCTAVE_WIDTH * (second // 12) - places[:, None]
        self.one, self.other = np.indices((FINGERS_PER_HAND,) * 2)
        self.same = self.one == self.other
        self.thumb = (self.one == THUMB) | (self.other == THUMB)
        self.distance = distance[..., None, None]
        """Distance from the first key up to the second, in semitones."""
        self.up = np.where(self.one < self.other, self.distance, -self.distance)
        """The same from the lower-numbered finger to the other one."""
        self.black = PITCH_CLASS_IS_BLACK[:, None, None, None]
        self.black_later = PITCH_CLASS_IS_BLACK[second % 12][..., None, None]
        self.displacement = np.abs(self.distance - (self.other - self.one) * _WHITE_WIDTH)
        """Distance that the hand moves, in semitones."""
        limits = np.zeros((6, FINGERS_PER_HAND, FINGERS_PER_HAND))
        for (low, high), reach in reaches.items():
            limits[:, low - 1, high - 1] = limits[:, high - 1, low - 1] = reach
        self.beyond_practical, self.beyond_comfortable, self.beyond_relaxed = (
            np.maximum(limits[n] - self.up, 0) + np.maximum(self.up - limits[5 - n], 0)
            for n in range(3)
        )


cost_tables = lru_cache(maxsize=8)(CostTables)
"""Compute tables, cached by weights, as it takes long."""
