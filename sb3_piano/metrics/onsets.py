"""Onset scores: which notes were struck on time, and how far from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.metrics.matching import IntPairs, match_in_order
from sb3_piano.metrics.presses import presses_of

ONSET_TOLERANCE = 0.05
"""Distance from its target onset within which a strike hits, in s. Source:
``mir_eval.transcription``; the curriculum-strategies report on RoboPianist, section 3."""

_MS_PER_S = 1000.0


class Onsets(NamedTuple):
    """n strikes of keys, in any order."""

    time: npt.NDArray[np.float64]
    """(n,) when the key is struck, in s since the start."""
    key: npt.NDArray[np.intp]
    """(n,) key, 0-87."""


class OnsetScores(NamedTuple):
    """Precision, recall and F1 over all strikes of a piece, in [0, 1]."""

    precision: float
    recall: float
    f1: float

    @classmethod
    def of_counts(cls, hits: int, strikes: int, targets: int) -> OnsetScores:
        """Return the scores of so many hits, strikes and target onsets."""
        return cls(
            precision=_ratio(hits, strikes),
            recall=_ratio(hits, targets),
            f1=_ratio(2 * hits, strikes + targets),
        )


class TimingError(NamedTuple):
    """Delay of the hits, in ms; early is negative."""

    mean: float
    std: float
    """Standard deviation of the population, i.e. divided by the number of hits."""


def onsets_of(active: npt.ArrayLike, control_timestep: float) -> Onsets:
    """Return the strikes in data that knows whole control steps only.

    A strike is taken to fall on the beginning of the first step of its press (see
    :func:`~sb3_piano.metrics.presses_of`), though the key may have gone down at any time within the
    step. A control step of 0.05 s is as long as the tolerance of the onset scores: between two
    such arrays a strike one step early or late still counts as a hit, two steps do not. A key
    struck again without a silent step in between is one strike. Where the time of a strike within
    the step is known, as in a ``Performance``, make the ``Onsets`` of that.

    Args:
        active: (T, n) bool, whether each key sounds in each control step.
        control_timestep: Length of a control step, in s.

    Returns:
        The strikes, ordered by step, then key.

    Raises:
        ValueError: If the array is not two-dimensional.
    """
    presses = presses_of(active)
    return Onsets(time=presses.first.astype(np.float64) * control_timestep, key=presses.key)


def match_onsets(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> IntPairs:
    """Pair target onsets with the strikes that hit them.

    A strike can hit a target onset of its own key at most ``tolerance`` away (the bound included,
    the distance rounded to 0.1 ms). Each onset is in at most one pair. There are as many pairs as
    possible; among all ways to have as many, the one is taken that keeps the order of time on each
    key and has the least sum of distances. If several have the same sum, earlier onsets are
    preferred.

    Source: ``mir_eval.transcription.match_notes`` with ``offset_ratio=None`` for what can be paired
    and for the number of pairs; of several largest matchings it takes any.

    Args:
        target: n target onsets.
        played: m strikes.
        tolerance: Greatest distance of a hit, in s, at least 0.

    Returns:
        (k, 2) indices of target and of played, ordered by target.

    Raises:
        ValueError: If times and keys do not go together.
    """
    return match_in_order(*_checked(target), *_checked(played), tolerance)


def onset_scores(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> OnsetScores:
    """Score how many notes were struck on time.

    With ``hits`` the number of pairs of :func:`match_onsets`: precision is ``hits / strikes``,
    recall is ``hits / targets`` and F1, their harmonic mean, ``2 hits / (strikes + targets)``, each
    1 where its denominator is 0. Hence playing nothing has precision 1, and F1 1 only if nothing is
    due. A strike that can hit nothing lowers precision; that is not to say that pressing a wrong
    key in one step more does, since it may lengthen a press or join two of them into one.

    Source: the curriculum-strategies report on RoboPianist, section 3. On pieces and performances
    that are not empty it is ``mir_eval.transcription.precision_recall_f1_overlap`` with
    ``offset_ratio=None``; where one is empty, mir_eval has 0.

    Args:
        target: n target onsets.
        played: m strikes.
        tolerance: Greatest distance of a hit, in s, at least 0.

    Raises:
        ValueError: If times and keys do not go together.
    """
    hits = len(match_onsets(target, played, tolerance))
    return OnsetScores.of_counts(hits, len(played.key), len(target.key))


def onset_f1(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> float:
    """Return the F1 of :func:`onset_scores`; 1.0 if nothing is due and nothing is struck.

    Args:
        target: n target onsets.
        played: m strikes.
        tolerance: Greatest distance of a hit, in s, at least 0.

    Raises:
        ValueError: If times and keys do not go together.
    """
    return onset_scores(target, played, tolerance).f1


def timing_error(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> TimingError:
    """Return mean and standard deviation of how late the hits are.

    Over the pairs of :func:`match_onsets`, of the time of the strike minus the target onset.

    Args:
        target: n target onsets.
        played: m strikes.
        tolerance: Greatest distance of a hit, in s, at least 0.

    Returns:
        Both in ms; 0.0 and 0.0 if there is no hit.

    Raises:
        ValueError: If times and keys do not go together.
    """
    return timing_error_of(target, played, match_onsets(target, played, tolerance))


def timing_error_of(target: Onsets, played: Onsets, pairs: IntPairs) -> TimingError:
    """Return the timing error of the pairs of :func:`match_onsets`."""
    if len(pairs) == 0:
        return TimingError(0.0, 0.0)
    late = (played.time[pairs[:, 1]] - target.time[pairs[:, 0]]) * _MS_PER_S
    return TimingError(float(late.mean()), float(late.std()))


def _checked(onsets: Onsets) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    time, key = np.asarray(onsets.time, dtype=float), np.asarray(onsets.key, dtype=np.intp)
    if time.ndim != 1 or time.shape != key.shape:
        raise ValueError(
            f"Onsets need one time for each key, got shapes {time.shape} and {key.shape}."
        )
    return time, key


def _ratio(numerator: int, denominator: int) -> float:
    return numerator / denominator if denominator else 1.0
