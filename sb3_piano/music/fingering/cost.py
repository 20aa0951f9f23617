"""Costs of a fingering: weights of its rules, and tables for one, two and three keys in succession.

Everything here is the right hand's: the left hand is its mirror image, and so are its keys. The
keyboard is its own mirror image about D, so that the mirrored keys keep their colours.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray

from sb3_piano.music.constants import (
    FINGERS_PER_HAND,
    LITTLE,
    MIDDLE,
    PITCH_CLASS_IS_BLACK,
    RING,
    THUMB,
)
from sb3_piano.settings import Number, Positive, Share, settings

Table = NDArray[np.float64]

MAX_INTERVAL = 87

_OCTAVE_WIDTH = 12.0
_WHITE_WIDTH = _OCTAVE_WIDTH / 7

_NotNegative = Annotated[Number, Ge(0)]


class Reach(NamedTuple):
    """Distance of two fingers of the right hand, from the lower-numbered to the other: its limits.

    In semitones, upwards positive; negative with the thumb passed under the other finger.
    """

    min_practical: float
    min_comfortable: float
    min_relaxed: float
    max_relaxed: float
    max_comfortable: float
    max_practical: float


PARNCUTT_REACHES: Mapping[tuple[int, int], Reach] = MappingProxyType(
    {
        (1, 2): Reach(-5, -3, 1, 5, 8, 10),
        (1, 3): Reach(-4, -2, 3, 7, 10, 12),
        (1, 4): Reach(-3, -1, 5, 9, 12, 14),
        (1, 5): Reach(-1, 1, 7, 10, 13, 15),
        (2, 3): Reach(1, 1, 1, 2, 3, 5),
        (2, 4): Reach(1, 1, 3, 4, 5, 7),
        (2, 5): Reach(2, 2, 5, 6, 8, 10),
        (3, 4): Reach(1, 1, 1, 2, 2, 4),
        (3, 5): Reach(1, 1, 3, 4, 5, 7),
        (4, 5): Reach(1, 1, 1, 2, 3, 5),
    }
)
"""The hand of the first ergonomic model, by pianists' finger numbers.

Source: Parncutt, Sloboda, Clarke, Raekallio and Desain 1997, "An ergonomic model of keyboard
fingering for melodic fragments", table 1.
"""

MEDIUM_REACHES: Mapping[tuple[int, int], Reach] = MappingProxyType(
    {
        (1, 2): Reach(-8, -6, 1, 5, 8, 10),
        (1, 3): Reach(-7, -5, 3, 9, 12, 14),
        (1, 4): Reach(-5, -3, 5, 11, 13, 15),
        (1, 5): Reach(-2, 0, 7, 12, 14, 16),
        (2, 3): Reach(1, 1, 1, 2, 5, 7),
        (2, 4): Reach(1, 1, 3, 4, 6, 8),
        (2, 5): Reach(2, 2, 5, 6, 10, 12),
        (3, 4): Reach(1, 1, 1, 2, 2, 4),
        (3, 5): Reach(1, 1, 3, 4, 6, 8),
        (4, 5): Reach(1, 1, 1, 2, 4, 6),
    }
)
"""A medium hand, measured for music with chords, by pianists' finger numbers.

Source: Balliauw, Herremans, Palhazi Cuervo and Sorensen 2017, "A variable neighborhood search
algorithm to generate piano fingerings for polyphonic sheet music", distance matrix of the medium
hand.
"""

REACHES: Mapping[str, Mapping[tuple[int, int], Reach]] = MappingProxyType(
    {"medium": MEDIUM_REACHES, "parncutt": PARNCUTT_REACHES}
)


@settings
class FingeringWeights:
    """The cost of each rule; a fingering is the one whose costs add up to the least.

    The names in quotes are the rules of Parncutt et al. 1997, in whose points everything counts.

    Attributes:
        hand: How far apart each pair of fingers can be: those of a "medium" hand, or "parncutt".
        physical: Share of the distance in mm (a semitone is 1/12 of an octave's width) in the
            distance between keys, the rest is semitones, in [0, 1]. Source: Jacobs 2001.
        stretch: "Stretch", per semitone beyond comfortable.
        span_thumb: "Small span" and "large span", per semitone beyond relaxed, with the thumb.
        span_fingers: The same for two fingers without the thumb.
        impractical: Per semitone beyond practical. Source: Balliauw et al. 2017.
        position_count: "Position change count", for a half change; a full one costs twice that.
        position_size: "Position change size", per semitone beyond comfortable.
        place: Per semitone that the hand's place changes from one key to the next: where its thumb
            would be with the fingers on neighbouring white keys.
        place_later: The same over two keys.
        same_finger: One finger on two keys in succession. Source: Balliauw et al. 2017.
        same_finger_size: The same, per semitone between the keys.
        other_finger: Another finger on the key that was struck last.
        other_finger_later: The same with one other key in between.
        leap: What the movement between two keys costs at most, however far they are apart.
        weak_four: "Weak finger", for the ring finger.
        weak_five: "Weak finger", for the little finger.
        three_four_five: "Three-four-five".
        three_to_four: "Three-to-four".
        four_on_black: "Four on black", with the third finger on a white key beside it.
        thumb_on_black: "Thumb on black".
        thumb_on_black_white: "Thumb on black", for each white key beside it.
        five_on_black: "Five on black", as for the thumb.
        five_on_black_white: "Five on black", for each white key beside it.
        passing: "Thumb passing", between keys of one colour.
        passing_size: Per semitone that a finger and the thumb pass each other by.
        passing_on_black: "Thumb passing", with the thumb on black and the finger on white.
        chord_finger: As `same_finger`, from or to a chord.
        chord_finger_size: As `same_finger_size`, from or to a chord.
        chord_shift: How much changes of position over three slices count with chords among them.
        chord: How much the reach counts between keys that are down together.
        pace: Time between notes at which the costs of movement count fully, in s.
        haste: Exponent with which they grow for faster notes and shrink for slower ones.
        rest: Silence after which they are down to 1/e, in s.
    """

    hand: Literal["medium", "parncutt"] = "medium"
    physical: Share = 0.48
    stretch: _NotNegative = 2.52
    span_thumb: _NotNegative = 0.93
    span_fingers: _NotNegative = 1.44
    impractical: _NotNegative = 10.0
    position_count: _NotNegative = 1.23
    position_size: _NotNegative = 0.71
    place: _NotNegative = 0.3
    place_later: _NotNegative = 0.28
    same_finger: _NotNegative = 32.8
    same_finger_size: _NotNegative = 2.1
    other_finger: _NotNegative = 3.18
    other_finger_later: _NotNegative = 0.79
    leap: Positive = 22.4
    weak_four: _NotNegative = 0.55
    weak_five: _NotNegative = 0.67
    three_four_five: _NotNegative = 0.23
    three_to_four: _NotNegative = 0.64
    four_on_black: _NotNegative = 0.83
    thumb_on_black: _NotNegative = 6.79
    thumb_on_black_white: _NotNegative = 1.73
    five_on_black: _NotNegative = 0.0
    five_on_black_white: _NotNegative = 6.18
    passing: _NotNegative = 1.24
    passing_size: _NotNegative = 0.43
    passing_on_black: _NotNegative = 3.0
    chord_finger: _NotNegative = 0.47
    chord_finger_size: _NotNegative = 0.51
    chord_shift: _NotNegative = 0.51
    chord: _NotNegative = 4.0
    pace: Positive = 0.25
    haste: _NotNegative = 0.5
    rest: Positive = 0.6


DEFAULT_WEIGHTS = FingeringWeights()
"""Tuned on the generated studies, in several runs of what benchmarks/tune_fingering_weights.py
does, and rounded."""

PARNCUTT_WEIGHTS = FingeringWeights(
    hand="parncutt",
    physical=0.0,
    stretch=2.0,
    span_thumb=1.0,
    span_fingers=2.0,
    impractical=1000.0,
    position_count=1.0,
    position_size=1.0,
    place=0.0,
    place_later=0.0,
    same_finger=0.0,
    same_finger_size=3.0,
    other_finger=0.0,
    other_finger_later=0.0,
    leap=1e9,
    weak_four=1.0,
    weak_five=1.0,
    three_four_five=1.0,
    three_to_four=1.0,
    four_on_black=1.0,
    thumb_on_black=1.0,
    thumb_on_black_white=2.0,
    five_on_black=0.0,
    five_on_black_white=2.0,
    passing=1.0,
    passing_size=0.0,
    passing_on_black=3.0,
    chord_finger=0.0,
    chord_finger_size=3.0,
    chord_shift=1.0,
    chord=1.0,
    haste=0.0,
    rest=1e9,
)
"""The twelve rules as first published, in points, for keys struck one at a time.

Source: Parncutt et al. 1997. What they rule out (reaches that are not practical, one finger on two
keys in succession) is dear here, and what they do not speak of is free.
"""


def key_positions(physical: float) -> Table:
    """Return where the keys of an octave from C are, in semitones: (12,).

    Args:
        physical: Share of the place on a real keyboard, in [0, 1]; the rest is the pitch.
    """
    white = np.array([(index + 0.5) * _WHITE_WIDTH for index in range(7)])
    # Behind the black keys the octave is cut into five and seven nearly equal strips.
    strips = [(index + 0.5) * 3 * _WHITE_WIDTH / 5 for index in range(5)]
    strips += [3 * _WHITE_WIDTH + (index + 0.5) * 4 * _WHITE_WIDTH / 7 for index in range(7)]
    of_white = white[np.cumsum(~PITCH_CLASS_IS_BLACK) - 1]
    places = np.where(PITCH_CLASS_IS_BLACK, strips, of_white)
    return physical * places + (1 - physical) * (np.arange(12) + 0.5)


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
        self.weights = w = weights
        pairs = _Pairs(weights)
        distance, same = pairs.distance, pairs.same
        change = w.place * pairs.displacement
        strained = self._limited(pairs.strain(w) + change)
        passing = pairs.passing(w)

        def moves(same_finger: float, size: float) -> Table:
            own = self._limited(same_finger + size * np.abs(distance) + change)
            own = np.where(distance == 0, 0.0, own)
            other = np.where(distance == 0, w.other_finger, strained)
            return np.where(same, own, other) + passing

        self.moves = moves(w.same_finger, w.same_finger_size)
        self.chord_moves = moves(w.chord_finger, w.chord_finger_size)
        self.colours = pairs.colours(w)
        self.grips = np.where(same, w.leap, w.chord * strained)
        self.far = same | (pairs.beyond_practical > 0)
        self.shifts, self.full_shifts = self._shifts(pairs)
        self.single = np.zeros((2, FINGERS_PER_HAND))
        self.single[:, RING] += w.weak_four
        self.single[:, LITTLE] += w.weak_five
        self.single[1, THUMB] += w.thumb_on_black
        self.single[1, LITTLE] += w.five_on_black
        self.triples = np.zeros((FINGERS_PER_HAND,) * 3)
        for fingers in np.ndindex(self.triples.shape):
            if sorted(fingers) == [MIDDLE, RING, LITTLE]:
                self.triples[fingers] = w.three_four_five

    def _shifts(self, pairs: _Pairs) -> tuple[Table, Table]:
        w = self.weights
        size = np.where(pairs.same, np.abs(pairs.distance), pairs.beyond_comfortable)
        change = w.place_later * pairs.displacement
        half = w.position_count * (size > 0) + w.position_size * size + change
        full = half + w.position_count * (~pairs.same & (pairs.beyond_practical > 0))
        later = w.other_finger_later * (~pairs.same & (pairs.distance == 0))
        return self._limited(half) + later, self._limited(full) + later

    def _limited(self, cost: Table) -> Table:
        """Let costs grow ever more slowly: of far keys none is nearer to a finger."""
        return cost * self.weights.leap / (cost + self.weights.leap)


class _Pairs:
    """Two keys with two fingers, in arrays that broadcast to (12, 175, 5, 5)."""

    def __init__(self, weights: FingeringWeights) -> None:
        second = np.arange(12)[:, None] + np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1)
        places = key_positions(weights.physical)
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
        """Distance that the hand's place moves, in semitones."""
        reaches = np.zeros((6, FINGERS_PER_HAND, FINGERS_PER_HAND))
        for (low, high), reach in REACHES[weights.hand].items():
            reaches[:, low - 1, high - 1] = reaches[:, high - 1, low - 1] = reach
        practical, comfortable, relaxed = (reaches[[n, 5 - n]] for n in range(3))
        self.beyond_practical = self._beyond(*practical)
        self.beyond_comfortable = self._beyond(*comfortable)
        self.beyond_relaxed = self._beyond(*relaxed)

    def _beyond(self, low: Table, high: Table) -> Table:
        return np.asarray(np.maximum(low - self.up, 0) + np.maximum(self.up - high, 0))

    def strain(self, weights: FingeringWeights) -> Table:
        """Return stretch, small span, large span and what is impractical, for two fingers."""
        span = np.where(self.thumb, weights.span_thumb, weights.span_fingers)
        return np.asarray(
            weights.stretch * self.beyond_comfortable
            + span * self.beyond_relaxed
            + weights.impractical * self.beyond_practical
        )

    def passing(self, weights: FingeringWeights) -> Table:
        """Return what it costs that thumb and finger pass each other."""
        first = self.one == THUMB
        thumb = np.where(first, self.black, self.black_later)
        finger = np.where(first, self.black_later, self.black)
        level = np.where(thumb == finger, weights.passing, 0.0)
        cost = np.where(thumb & ~finger, weights.passing_on_black, level)
        semitones = np.abs(np.arange(-MAX_INTERVAL, MAX_INTERVAL + 1))[:, None, None]
        # Limited, since far keys are reached with a leap, and nothing passes.
        size = weights.passing_size * np.minimum(semitones, _OCTAVE_WIDTH)
        return np.where(self.thumb & ~self.same & (self.up < 0), cost + size, 0.0)

    def colours(self, weights: FingeringWeights) -> Table:
        """Return what the colours of two keys cost."""
        up, down = ~self.black & self.black_later, self.black & ~self.black_later
        cost = np.zeros(np.broadcast_shapes(up.shape, self.one.shape))
        cost[..., MIDDLE, RING] += weights.three_to_four + weights.four_on_black * up[..., 0, 0]
        cost[..., RING, MIDDLE] += weights.four_on_black * down[..., 0, 0]
        for finger, extra in (
            (THUMB, weights.thumb_on_black_white),
            (LITTLE, weights.five_on_black_white),
        ):
            cost += extra * (down & (self.one == finger) & ~self.same)
            cost += extra * (up & (self.other == finger) & ~self.same)
        return cost


@lru_cache(maxsize=8)
def cost_tables(weights: FingeringWeights) -> CostTables:
    """Return the tables of `weights`, which take a moment to work out, once."""
    return CostTables(weights)
