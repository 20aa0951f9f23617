"""Interquartile means over pieces and seeds, with stratified bootstrap intervals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import FloatArray
from sb3_piano.training.evaluation.statistics import CONFIDENCE, Interval

RESAMPLES = 9999
_SEED = 0  # equal results have equal intervals


class Aggregate(NamedTuple):
    """Aggregate score of a player over several pieces."""

    iqm: float
    """Mean of the middle half of the scores of all pieces and seeds."""
    over_seeds: Interval | None
    """Interval for other seeds on the same pieces; ``None`` if scores do not vary by seed."""
    over_pieces: Interval | None
    """Interval for other seeds and similar pieces; ``None`` for one piece."""


def aggregate(scores: npt.ArrayLike) -> Aggregate:
    """Return the interquartile mean of (n_pieces, n_seeds) scores, with its 95 % intervals.

    The bootstrap is stratified: seeds are resampled within each piece. For other pieces, pieces are
    resampled first. The ends are the 2.5 % and 97.5 % quantiles of 9999 resamples.

    Source:
        Agarwal et al., Deep Reinforcement Learning at the Edge of the Statistical Precipice (2021).
        rliable's ``StratifiedBootstrap`` draws in the same way (``task_bootstrap`` for pieces).
        rliable itself is not used, as it requires arch 7, which pandas 3 breaks.

    Raises:
        ValueError: If there are no scores, or pieces have different numbers of seeds.
    """
    values = np.asarray(scores, dtype=np.float64)
    if values.ndim != 2 or values.size == 0:
        raise ValueError(
            f"Scores have the shape {values.shape}: expected (n_pieces, n_seeds), 1 each at least."
        )
    seeds_differ = bool(np.any(np.ptp(values, axis=1) > 0))
    return Aggregate(
        iqm=float(interquartile_mean(values.reshape(1, -1))[0]),
        over_seeds=_interval(values, draw_pieces=False) if seeds_differ else None,
        over_pieces=_interval(values, draw_pieces=True) if len(values) > 1 else None,
    )


def interquartile_mean(values: FloatArray) -> FloatArray:
    """Return the (n,) means of the middle half of each row of (n, k) values."""
    from scipy import stats  # slow to import

    means: FloatArray = stats.trim_mean(values, 0.25, axis=1)
    return means


def _interval(values: FloatArray, *, draw_pieces: bool) -> Interval:
    """Return the ends of the percentile interval of the interquartile mean."""
    random = np.random.default_rng(_SEED)
    n_pieces, n_seeds = values.shape
    pieces = np.arange(n_pieces)[None, :, None]
    if draw_pieces:
        pieces = random.integers(n_pieces, size=(RESAMPLES, n_pieces, 1))
    seeds = random.integers(n_seeds, size=(RESAMPLES, n_pieces, n_seeds))
    means = interquartile_mean(values[pieces, seeds].reshape(RESAMPLES, -1))
    low, high = np.quantile(means, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)
