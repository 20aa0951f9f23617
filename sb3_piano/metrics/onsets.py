"""Onset scores: notes struck in time, and their timing errors."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.metrics.presses import presses_of
from sb3_piano.music import PianoRoll

IntPairs = npt.NDArray[np.intp]
"""(k, 2) pairs of indices."""

ONSET_TICKS_PER_S = 10_000
"""Distances from onsets are rounded to ticks of 0.1 ms, as in mir_eval, so that 0.15 s - 0.1 s is
0.05 s."""

# By how much the search for close events reaches farther than the tolerance, in s; what is too far
# after rounding is then left out.
_REACH = 0.001

Row = tuple[int, list[int]]
"""First event of b close to one of a; worth of the pair with it and with each that follows,
0 where there can be no pair."""

_Condition = Callable[[IntArray, IntArray], BoolArray]

ONSET_TOLERANCE = 0.05
"""Distance from its target onset within which a strike hits, in s. Source:
``mir_eval.transcription``; the curriculum-strategies report on RoboPianist, section 3."""

_MS_PER_S = 1000.0


class Onsets(NamedTuple):
    """n strikes of keys, in any order."""

    time: npt.NDArray[np.float64]
    """(n,) time of the strike, s since the start."""
    key: npt.NDArray[np.intp]
    """(n,) key, 0-87."""


class OnsetScores(NamedTuple):
    """Precision, recall and F1 over all strikes of a piece, in [0, 1]."""

    precision: float
    recall: float
    f1: float

    @classmethod
    def of_counts(cls, hits: int, strikes: int, targets: int) -> OnsetScores:
        """Return the scores from the numbers of hits, strikes and target onsets."""
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
    """Return the strikes in data of whole control steps.

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


def rounded_distance(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return distances of times, s, rounded to ticks."""
    return np.rint(np.abs(a - b) * ONSET_TICKS_PER_S) / ONSET_TICKS_PER_S


def match_onsets(
    target: Onsets,
    played: Onsets,
    tolerance: float = ONSET_TOLERANCE,
    also: _Condition | None = None,
) -> IntPairs:
    """Pair target onsets with the strikes that hit them.

    A strike can hit a target onset of its own key at most ``tolerance`` away (the bound included,
    the distance rounded to 0.1 ms). Each onset is in at most one pair. There are as many pairs as
    possible; among all ways to have as many, the one is taken that keeps the order of time on each
    key and has the least sum of distances. If several have the same sum, earlier onsets are
    preferred.

    Source: ``mir_eval.transcription.match_notes`` with ``offset_ratio=None`` for the possible pairs
    and their number; mir_eval takes any of several largest matchings.

    Args:
        target: n target onsets.
        played: m strikes.
        tolerance: Greatest distance of a hit, in s, at least 0.
        also: A further condition: (p,) bool from (p,) indices of target and (p,) of played.

    Returns:
        (k, 2) indices of target and of played, ordered by target.

    Raises:
        ValueError: If times and keys do not go together.
    """
    target, played = _checked(target), _checked(played)
    if len(target.key) == 0 or len(played.key) == 0:
        return np.empty((0, 2), dtype=np.intp)
    # Exact, and linear in the number of close events: dynamic programming, as for the longest
    # common subsequence, over the events sorted by key and time; each onset (of a) looks only at
    # those strikes (of b) that are close to it. Keeping the order of time costs no pair: of two
    # crossed pairs, the distances of the uncrossed ones are no greater than the greater of the two.
    order_a, order_b = (np.lexsort((one.time, one.key)) for one in (target, played))
    a = Onsets(target.time[order_a], target.key[order_a])
    b = Onsets(played.time[order_b], played.key[order_b])
    given = None if also is None else lambda row, column: also(order_a[row], order_b[column])
    pairs = np.array(_best_path(_close_rows(a, b, tolerance, given)), dtype=np.intp).reshape(-1, 2)
    matched = np.stack([order_a[pairs[:, 0]], order_b[pairs[:, 1]]], axis=1)
    return matched[np.argsort(matched[:, 0])]


def onset_scores(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> OnsetScores:
    """Score the notes struck in time.

    With ``hits`` the number of pairs of :func:`match_onsets`: precision is ``hits / strikes``,
    recall is ``hits / targets`` and F1, their harmonic mean, ``2 hits / (strikes + targets)``, each
    1 where its denominator is 0. Hence playing nothing has precision 1, and F1 1 only if nothing is
    due. A strike that can hit nothing lowers precision; that is not to say that pressing a wrong
    key in one step more does, since it may lengthen a press or join two of them into one.

    Source: the curriculum-strategies report on RoboPianist, section 3. On pieces and performances
    that are not empty it is ``mir_eval.transcription.precision_recall_f1_overlap`` with
    ``offset_ratio=None``; where one is empty, mir_eval has 0. The arguments are those of
    :func:`match_onsets`.

    Raises:
        ValueError: If times and keys do not go together.
    """
    hits = len(match_onsets(target, played, tolerance))
    return OnsetScores.of_counts(hits, len(played.key), len(target.key))


def onset_f1(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> float:
    """Return the F1 of :func:`onset_scores`."""
    return onset_scores(target, played, tolerance).f1


def timing_error(target: Onsets, played: Onsets, tolerance: float = ONSET_TOLERANCE) -> TimingError:
    """Return mean and standard deviation of the hits' delay.

    Over the pairs of :func:`match_onsets`, of the same arguments: the time of the strike minus the
    target onset, in ms; 0.0 and 0.0 if there is no hit.
    """
    return timing_error_of(target, played, match_onsets(target, played, tolerance))


def timing_error_of(target: Onsets, played: Onsets, pairs: IntPairs) -> TimingError:
    """Return the timing error of the pairs of :func:`match_onsets`."""
    if len(pairs) == 0:
        return TimingError(0.0, 0.0)
    late = (played.time[pairs[:, 1]] - target.time[pairs[:, 0]]) * _MS_PER_S
    return TimingError(float(late.mean()), float(late.std()))


def _checked(onsets: Onsets) -> Onsets:
    time, key = np.asarray(onsets.time, dtype=float), np.asarray(onsets.key, dtype=np.intp)
    if time.ndim != 1 or time.shape != key.shape:
        raise ValueError(
            f"Onsets need one time for each key, got shapes {time.shape} and {key.shape}."
        )
    return Onsets(time, key)


def _ratio(numerator: int, denominator: int) -> float:
    return numerator / denominator if denominator else 1.0


def _close_rows(a: Onsets, b: Onsets, tolerance: float, also: _Condition | None) -> list[Row]:
    """Return a row for each event of a; events are sorted by key, then time."""
    # One axis for all keys, those of different keys out of each other's reach.
    times = np.concatenate([a.time, b.time])
    stride = np.ptp(times) + 2 * (tolerance + _REACH)
    place_a, place_b = a.time + stride * a.key, b.time + stride * b.key
    first = np.searchsorted(place_b, place_a - tolerance - _REACH, side="left")
    end = np.searchsorted(place_b, place_a + tolerance + _REACH, side="right")
    lengths = end - first
    row = np.repeat(np.arange(len(a.key)), lengths)
    starts = np.cumsum(lengths) - lengths
    column = np.arange(len(row)) - starts[row] + first[row]
    ticks = np.rint(np.abs(a.time[row] - b.time[column]) * ONSET_TICKS_PER_S)
    close = ticks / ONSET_TICKS_PER_S <= tolerance
    if also is not None:
        close &= also(row, column)
    # A pair more outweighs all distances together.
    pair = len(a.key) * (round(tolerance * ONSET_TICKS_PER_S) + 1) + 1
    worth = np.where(close, pair - ticks, 0).astype(np.int64).tolist()
    bounds = zip(first.tolist(), starts.tolist(), lengths.tolist(), strict=True)
    return [(j, worth[start : start + length]) for j, start, length in bounds]


def _best_path(rows: list[Row]) -> list[tuple[int, int]]:
    """Return the pairs (row, event of b) with the greatest total worth.

    ``best[i][x]`` is the greatest worth with rows up to i and the events of b before
    ``rows[i][0] + x``. Rows begin and end in order, so that more than what is kept of a row is
    never asked for by the next.
    """
    best: list[list[int]] = []
    start, former = 0, [0]
    for first, worth in rows:
        last = len(former) - 1
        value = former[min(first - start, last)]
        row = [value]
        for x, gain in enumerate(worth, start=first - start):
            paired = former[min(x, last)] + gain if gain else 0
            value = max(value, former[min(x + 1, last)], paired)
            row.append(value)
        best.append(row)
        start, former = first, row
    return _trace(rows, best)


def _trace(rows: list[Row], best: list[list[int]]) -> list[tuple[int, int]]:
    """Walk back through the worths; skip unneeded events, the latest first.

    ``j`` is how many events of b are left; it never falls below the first of the row.
    """
    pairs = []
    i, j = len(rows) - 1, rows[-1][0] + len(rows[-1][1])
    while i >= 0:
        first, worth = rows[i]
        x = min(j - first, len(worth))
        if best[i][x] == _before(rows, best, i, first + x):
            i -= 1
        elif best[i][x] == best[i][x - 1]:
            j = first + x - 1
        else:
            j = first + x - 1
            pairs.append((i, j))
            i -= 1
    return pairs


def _before(rows: list[Row], best: list[list[int]], i: int, j: int) -> int:
    """Return the greatest worth with the rows before i and the events of b before j."""
    if i == 0:
        return 0
    first, worth = rows[i - 1]
    return best[i - 1][min(j - first, len(worth))]


class OpenOnsets:
    """Onsets of a piece that no strike has hit yet.

    :func:`match_onsets` pairs strikes and onsets when all strikes are known. Here each strike takes
    the nearest open onset during an episode. The two differ only if strikes of one key are closer
    than twice the tolerance.
    """

    def __init__(self, roll: PianoRoll) -> None:
        self._times: dict[int, list[float]] = {}  # by key, s
        for _, key, time in roll.strikes():
            self._times.setdefault(key, []).append(time)

    def copy(self) -> OpenOnsets:
        """Return an independent copy."""
        copied = copy.copy(self)
        copied._times = {key: list(times) for key, times in self._times.items()}
        return copied

    def hit_within(self, key: int, earliest: float, latest: float) -> bool | None:
        """Return :meth:`hit` of a strike from ``earliest`` to ``latest``, s, if no time changes it.

        If the result depends on the exact time, return ``None`` and hit nothing.
        """
        times = self._times.get(key, [])
        near = [onset for onset in times if _in_time(onset, min(max(onset, earliest), latest))]
        if not near:
            return False
        if len(near) > 1 or not (_in_time(near[0], earliest) and _in_time(near[0], latest)):
            return None
        times.remove(near[0])
        return True

    def hit(self, key: int, time: float) -> bool:
        """Match a strike (key 0 to 87; s) to an open onset; return whether one is in time."""
        times = self._times.get(key, [])
        near = [onset for onset in times if _in_time(onset, time)]
        if near:
            times.remove(min(near, key=lambda onset: abs(onset - time)))
        return bool(near)


def _in_time(onset: float, time: float) -> bool:
    return round(abs(onset - time) * ONSET_TICKS_PER_S) / ONSET_TICKS_PER_S <= ONSET_TOLERANCE
