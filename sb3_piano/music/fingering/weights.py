"""What makes a fingering hard: how far the fingers of a hand reach, and what each rule costs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import NamedTuple

from sb3_piano.exceptions import ConfigError


class Reach(NamedTuple):
    """How far apart two fingers of the right hand can be, from the lower-numbered to the other.

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


@dataclass(frozen=True, kw_only=True)
class FingeringWeights:
    """The cost of each rule; a fingering is the one whose costs add up to the least.

    The names in quotes are the rules of Parncutt et al. 1997, in whose points everything counts.

    Attributes:
        reaches: How far apart each pair of fingers can be.
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

    reaches: Mapping[tuple[int, int], Reach] = field(
        default_factory=lambda: MEDIUM_REACHES, hash=False
    )
    physical: float = 0.48
    stretch: float = 2.52
    span_thumb: float = 0.93
    span_fingers: float = 1.44
    impractical: float = 10.0
    position_count: float = 1.23
    position_size: float = 0.71
    place: float = 0.3
    place_later: float = 0.28
    same_finger: float = 32.8
    same_finger_size: float = 2.1
    other_finger: float = 3.18
    other_finger_later: float = 0.79
    leap: float = 22.4
    weak_four: float = 0.55
    weak_five: float = 0.67
    three_four_five: float = 0.23
    three_to_four: float = 0.64
    four_on_black: float = 0.83
    thumb_on_black: float = 6.79
    thumb_on_black_white: float = 1.73
    five_on_black: float = 0.0
    five_on_black_white: float = 6.18
    passing: float = 1.24
    passing_size: float = 0.43
    passing_on_black: float = 3.0
    chord_finger: float = 0.47
    chord_finger_size: float = 0.51
    chord_shift: float = 0.51
    chord: float = 4.0
    pace: float = 0.25
    haste: float = 0.5
    rest: float = 0.6

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == "reaches":
                continue
            if entry.name in _POSITIVE and not 0 < value < math.inf:
                raise ConfigError(f"Weight {entry.name} is {value}: expected a number above 0.")
            if not 0 <= value < math.inf:
                raise ConfigError(f"Weight {entry.name} is {value}: expected a number from 0.")
        if self.physical > 1:
            raise ConfigError(f"Weight physical is {self.physical}: expected a share, at most 1.")


_POSITIVE = ("leap", "pace", "rest")
"""What is divided by."""

DEFAULT_WEIGHTS = FingeringWeights()
"""Tuned on the generated studies, in several runs of what benchmarks/tune_fingering_weights.py
does, and rounded."""

PARNCUTT_WEIGHTS = FingeringWeights(
    reaches=PARNCUTT_REACHES,
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
