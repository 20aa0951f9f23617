"""Frame scores: sounding keys against due keys, in each control step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, IntArray


class FrameScores(NamedTuple):
    """Precision, recall and F1, each a mean over control steps, in [0, 1]."""

    precision: float
    recall: float
    f1: float


def frame_scores(target: npt.ArrayLike, played: npt.ArrayLike) -> FrameScores:
    """Compare sounding keys with due keys in each control step.

    In each step, with ``tp`` keys that sound and should, ``p`` keys that sound and ``t`` keys that
    should: precision is ``tp / p``, recall is ``tp / t`` and F1 is ``2 tp / (p + t)``, each 1 where
    its denominator is 0. The result is the mean over the steps. Hence playing nothing has
    precision 1, and silence where silence is due counts as perfect; compare with ``noop_scores``.

    Every step weighs the same. ``mir_eval.multipitch`` has another number by the same name: there
    every key weighs the same, since ``tp``, ``p`` and ``t`` are summed over all steps first.

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
    target, played = same_frames(target, played)
    hit, sounding, due = (keys.sum(axis=1) for keys in (target & played, played, target))
    return FrameScores(
        precision=_mean_ratio(hit, sounding),
        recall=_mean_ratio(hit, due),
        f1=_mean_ratio(2 * hit, sounding + due),
    )


def frame_f1(target: npt.ArrayLike, played: npt.ArrayLike) -> float:
    """Return the F1 of :func:`frame_scores`."""
    return frame_scores(target, played).f1


def non_silent_f1(target: npt.ArrayLike, played: npt.ArrayLike) -> float:
    """Return the mean F1 of the control steps with due keys.

    F1 of a step is ``2 tp / (p + t)`` as in :func:`frame_scores`; the mean is over those steps in
    which at least one key is due (``t > 0``). Playing nothing scores 0. A key that sounds in the
    silence of the piece costs nothing here.

    Source: the curriculum-strategies report on RoboPianist, section 3, "F1 over the passages where
    the piece sounds". It leaves the kind of mean open; here it is that of ``frame_scores``.
    Arguments are (T, n) bool, as there.

    Returns:
        The mean, in [0, 1]; 1.0 if no key is due at any step.

    Raises:
        ValueError: If the shapes differ or are not two-dimensional.
    """
    target, played = same_frames(target, played)
    due = target.any(axis=1)
    return frame_f1(target[due], played[due])


def noop_scores(target: npt.ArrayLike) -> FrameScores:
    """Return the frame scores of playing nothing, the baseline of any score.

    Args:
        target: (T, n) bool, what should sound.

    Returns:
        Precision 1.0; as recall and as F1 the share of the steps in which nothing is due, 1.0 if
        there is no step at all.

    Raises:
        ValueError: If the target is not two-dimensional.
    """
    target = np.asarray(target, dtype=bool)
    return frame_scores(target, np.zeros_like(target))


def same_frames(target: npt.ArrayLike, played: npt.ArrayLike) -> tuple[BoolArray, BoolArray]:
    """Return both as bool arrays; raise ValueError unless both are (T, n)."""
    target, played = np.asarray(target, dtype=bool), np.asarray(played, dtype=bool)
    if target.ndim != 2 or target.shape != played.shape:
        raise ValueError(
            f"Target and played must be (steps, keys) arrays of one shape, got {target.shape} "
            f"and {played.shape}."
        )
    return target, played


def _mean_ratio(numerator: IntArray, denominator: IntArray) -> float:
    """Return the mean of ratios, each 1 where its denominator is 0; 1.0 without ratios."""
    if len(numerator) == 0:
        return 1.0
    ratio = np.ones(len(numerator))
    np.divide(numerator, denominator, out=ratio, where=denominator > 0)
    return float(ratio.mean())
