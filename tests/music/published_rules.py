"""The twelve rules of fingering as first published, in points, for keys struck one at a time.

Source: Parncutt, Sloboda, Clarke, Raekallio and Desain 1997, "An ergonomic model of keyboard
fingering for melodic fragments". What they rule out (reaches that are not practical, one finger on
two keys in succession) is dear here, and what they do not speak of is free.
"""

from __future__ import annotations

from dataclasses import fields

from sb3_piano.music.fingering.cost import FingeringWeights

_POINTS = {
    "span_thumb": 1.0,
    "position_count": 1.0,
    "position_size": 1.0,
    "weak_four": 1.0,
    "weak_five": 1.0,
    "three_four_five": 1.0,
    "three_to_four": 1.0,
    "four_on_black": 1.0,
    "thumb_on_black": 1.0,
    "passing": 1.0,
    "chord_shift": 1.0,
    "chord": 1.0,
    "stretch": 2.0,
    "span_fingers": 2.0,
    "thumb_on_black_white": 2.0,
    "five_on_black_white": 2.0,
    "same_finger_size": 3.0,
    "chord_finger_size": 3.0,
    "passing_on_black": 3.0,
    "impractical": 1000.0,
    "leap": 1e9,
    "rest": 1e9,
    "pace": 1.0,
}

PARNCUTT_WEIGHTS = FingeringWeights(
    **{field.name: _POINTS.get(field.name, 0.0) for field in fields(FingeringWeights)}
)

PARNCUTT_HAND = {
    (1, 2): (-5, -3, 1, 5, 8, 10),
    (1, 3): (-4, -2, 3, 7, 10, 12),
    (1, 4): (-3, -1, 5, 9, 12, 14),
    (1, 5): (-1, 1, 7, 10, 13, 15),
    (2, 3): (1, 1, 1, 2, 3, 5),
    (2, 4): (1, 1, 3, 4, 5, 7),
    (2, 5): (2, 2, 5, 6, 8, 10),
    (3, 4): (1, 1, 1, 2, 2, 4),
    (3, 5): (1, 1, 3, 4, 5, 7),
    (4, 5): (1, 1, 1, 2, 3, 5),
}
"""Table 1 there: distances between pianists' fingers."""
