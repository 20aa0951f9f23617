"""How well a piece was played: pure functions from arrays to numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

BoolArray = npt.NDArray[np.bool_]

EPISODE_METRICS = (
    "precision",
    "recall",
    "f1",
    "sustain_precision",
    "sustain_recall",
    "sustain_f1",
)
"""Names of the music metrics that an environment puts into ``info`` at the end of an episode."""


class FrameScores(NamedTuple):
    """Precision, recall and F1, each a mean over control steps, in [0, 1]."""

    precision: float
    recall: float
    f1: float


def frame_scores(target: npt.ArrayLike, played: npt.ArrayLike) -> FrameScores:
    """Compare, control step by control step, what sounds with what should sound.

    In each step, with ``tp`` keys that sound and should, ``p`` keys that sound and ``t`` keys that
    should: precision is ``tp / p``, recall is ``tp / t`` and F1 is ``2 tp / (p + t)``, each 1 where
    its denominator is 0. The result is the mean over the steps. Hence playing nothing has
    precision 1, and silence where silence is due counts as perfect; compare with ``noop_scores``.

    Source: RoboPianist (Zakka et al. 2023), ``MidiEvaluationWrapper``, which calls scikit-learn's
    ``precision_recall_fscore_support(average="binary", zero_division=1)`` in each step.

    Args:
        target: (T, n) bool, what should sound. For the pedal, n is 1.
        played: (T, n) bool, what does sound.

    Returns:
        The three means; all 1.0 if there is no step at all.

    Raises:
        ValueError: If the shapes differ or are not two-dimensional.
    """
    target, played = np.asarray(target, dtype=bool), np.asarray(played, dtype=bool)
    if target.ndim != 2 or target.shape != played.shape:
        raise ValueError(
            f"Target and played must be (steps, keys) arrays of one shape, got {target.shape} "
            f"and {played.shape}."
        )
    if len(target) == 0:
        return FrameScores(1.0, 1.0, 1.0)
    hits = (target & played).sum(axis=1)
    n_played, n_due = played.sum(axis=1), target.sum(axis=1)
    return FrameScores(
        precision=_mean_ratio(hits, n_played),
        recall=_mean_ratio(hits, n_due),
        f1=_mean_ratio(2 * hits, n_played + n_due),
    )


def noop_scores(target: npt.ArrayLike) -> FrameScores:
    """Return the frame scores of playing nothing: the baseline that any score must beat.

    Args:
        target: (T, n) bool, what should sound.
    """
    target = np.asarray(target, dtype=bool)
    return frame_scores(target, np.zeros_like(target))


def episode_metrics(
    target_keys: BoolArray, played_keys: BoolArray, target_pedal: BoolArray, played_pedal: BoolArray
) -> dict[str, float]:
    """Return all ``EPISODE_METRICS`` of an episode, by name.

    Args:
        target_keys: (T, 88) bool.
        played_keys: (T, 88) bool.
        target_pedal: (T,) bool.
        played_pedal: (T,) bool.
    """
    keys = frame_scores(target_keys, played_keys)
    pedal = frame_scores(target_pedal[:, None], played_pedal[:, None])
    return dict(zip(EPISODE_METRICS, (*keys, *pedal), strict=True))


def _mean_ratio(numerator: npt.NDArray[np.int_], denominator: npt.NDArray[np.int_]) -> float:
    ratio = np.ones(len(numerator))
    np.divide(numerator, denominator, out=ratio, where=denominator > 0)
    return float(ratio.mean())
