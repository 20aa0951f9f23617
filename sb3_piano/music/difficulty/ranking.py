"""The rank of pieces by difficulty: weighted z-scores of their features.

The formula is that of E. Farah, I. Lin and G. Walrath, "Curriculum Strategies for Bimanual
Dexterous Piano Playing in RoboPianist", section 5.1.1: over all pieces that are ranked,

    D = 0.25 z(average polyphony) + 0.15 z(maximum polyphony) + 0.20 z(onset density)
      + 0.10 z(action variance) + 0.10 z(hand motion) + 0.10 z(fingertip motion).

The weights sum to 0.90, not 1; they are kept, since only the order counts. The last three features
are those of recorded performances. Without recordings D has the terms that a score knows, the first
three and 0.10 z(hand motion), in which the way of the hands' centres along the keyboard stands for
that of the joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sb3_piano.exceptions import ConfigError
from sb3_piano.music.difficulty.features import Features
from sb3_piano.music.difficulty.motion import MotionFeatures

_SCORE_TERMS: Sequence[tuple[float, Callable[[Features], float]]] = (
    (0.25, lambda piece: piece.average_polyphony),
    (0.15, lambda piece: piece.maximum_polyphony),
    (0.20, lambda piece: piece.onset_density),
)
_HANDS_ALONG_KEYBOARD: tuple[float, Callable[[Features], float]] = (
    0.10,
    lambda piece: piece.hand_motion,
)
_MOTION_TERMS: Sequence[tuple[float, Callable[[MotionFeatures], float]]] = (
    (0.10, lambda motion: motion.action_variance),
    (0.10, lambda motion: motion.hand_motion),
    (0.10, lambda motion: motion.fingertip_motion),
)

_CONSTANT = 1e-9
"""A feature that varies less than this, relative to its size, is constant but for rounding."""


@dataclass(frozen=True, kw_only=True)
class Difficulty:
    """How hard a piece is among those it was ranked with."""

    score: float
    """D of the formula: 0 for the average piece, the higher the harder."""
    rank: int
    """Its place among the pieces, 1 for the easiest; those of equal score share the lowest."""
    percentile: float
    """Its percentile rank, above 0 and up to 100: the place as a share of the number of pieces, in
    %; of equal scores the mean place. (The paper's percentiles are multiples of 1/303, as those of
    303 pieces are.)"""


def rank(
    features: Mapping[str, Features], motion: Mapping[str, MotionFeatures] | None = None
) -> dict[str, Difficulty]:
    """Rank pieces by difficulty.

    A z-score is a difference from the pieces' mean in standard deviations (of the population); of a
    feature that is the same for all it is 0. So every value depends on all pieces ranked with it,
    and z-scores over some of them do not compare with those over others: recordings are of all
    pieces, or of none.

    Args:
        features: Features of each piece by its name.
        motion: Features of a recorded performance of each piece by its name; None to rank by the
            scores alone. What it has of other pieces is ignored.

    Returns:
        The difficulty of each piece by its name, the easiest first, equal ones by name.

    Raises:
        ConfigError: If a piece has no recorded performance, but `motion` is given.
    """
    names = sorted(features)
    if not names:
        return {}
    pieces = [features[name] for name in names]
    score_terms = _SCORE_TERMS if motion is not None else (*_SCORE_TERMS, _HANDS_ALONG_KEYBOARD)
    terms = [weight * _z([feature(piece) for piece in pieces]) for weight, feature in score_terms]
    if motion is not None:
        _check_recorded(names, motion)
        played = [motion[name] for name in names]
        terms += [weight * _z([feature(p) for p in played]) for weight, feature in _MOTION_TERMS]
    return _ranked(names, np.sum(terms, axis=0))


def _z(values: Sequence[float]) -> npt.NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    spread = float(array.std())
    if spread <= _CONSTANT * float(np.abs(array).max()):
        return np.zeros(len(array))
    return np.asarray((array - array.mean()) / spread)


def _check_recorded(names: Sequence[str], motion: Mapping[str, MotionFeatures]) -> None:
    missing = [name for name in names if name not in motion]
    if missing:
        raise ConfigError(
            f"{len(missing)} of {len(names)} pieces have no recorded performance, first "
            f"{missing[0]!r}: expected one of each piece, or none at all."
        )


def _ranked(names: Sequence[str], scores: npt.NDArray[np.float64]) -> dict[str, Difficulty]:
    # Equal pieces may differ by rounding, as sums over others do.
    scores = scores.round(9) + 0.0
    in_order = np.sort(scores)
    below = np.searchsorted(in_order, scores, side="left")
    up_to = np.searchsorted(in_order, scores, side="right")
    found = {
        name: Difficulty(
            score=float(scores[index]),
            rank=int(below[index]) + 1,
            percentile=100.0 * float(below[index] + 1 + up_to[index]) / 2 / len(names),
        )
        for index, name in enumerate(names)
    }
    return dict(sorted(found.items(), key=lambda item: (item[1].score, item[0])))
