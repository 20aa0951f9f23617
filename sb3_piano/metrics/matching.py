"""One-to-one matching of events on several keys in time: exact, and linear in what is close."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntPairs = npt.NDArray[np.intp]
"""(k, 2) pairs of indices."""

# Distances are rounded to ticks of 0.1 ms, as in mir_eval, so that 0.15 s - 0.1 s is 0.05 s.
_TICKS_PER_S = 10_000

# By how much the search for close events reaches farther than the tolerance, in s; what is too far
# after rounding is then left out.
_REACH = 0.001


def match_in_order(
    time_a: FloatArray,
    key_a: npt.NDArray[np.intp],
    time_b: FloatArray,
    key_b: npt.NDArray[np.intp],
    tolerance: float,
) -> IntPairs:
    """Pair events of a with events of the same key in b that are at most ``tolerance`` away.

    Dynamic programming, as for the longest common subsequence, over the events sorted by key and
    time; each event of a looks only at those of b that are close to it. Keeping the order of time
    costs no pair: of two crossed pairs, the distances of the uncrossed ones are no greater than the
    greater of the two.

    Args:
        time_a: (n,) s.
        key_a: (n,) keys.
        time_b: (m,) s.
        key_b: (m,) keys.
        tolerance: Greatest distance, in s.

    Returns:
        (k, 2) indices of a and b, ordered by a: as many as can be, then of the least sum of
        distances in ticks, then the earlier events.
    """
    if len(time_a) == 0 or len(time_b) == 0:
        return np.empty((0, 2), dtype=np.intp)
    order_a, order_b = np.lexsort((time_a, key_a)), np.lexsort((time_b, key_b))
    rows = _close_rows(time_a[order_a], key_a[order_a], time_b[order_b], key_b[order_b], tolerance)
    pairs = np.array(_best_path(rows), dtype=np.intp).reshape(-1, 2)
    matched = np.stack([order_a[pairs[:, 0]], order_b[pairs[:, 1]]], axis=1)
    return matched[np.argsort(matched[:, 0])]


Row = tuple[int, list[int]]
"""First event of b that is close to one of a; worth of the pair with it and with each that follows,
0 where there can be no pair."""


def _close_rows(
    time_a: FloatArray,
    key_a: npt.NDArray[np.intp],
    time_b: FloatArray,
    key_b: npt.NDArray[np.intp],
    tolerance: float,
) -> list[Row]:
    """Return a row for each event of a; events are sorted by key, then time."""
    # One axis for all keys, those of different keys out of each other's reach.
    times = np.concatenate([time_a, time_b])
    stride = np.ptp(times) + 2 * (tolerance + _REACH)
    place_a, place_b = time_a + stride * key_a, time_b + stride * key_b
    first = np.searchsorted(place_b, place_a - tolerance - _REACH, side="left")
    end = np.searchsorted(place_b, place_a + tolerance + _REACH, side="right")
    lengths = end - first
    a = np.repeat(np.arange(len(time_a)), lengths)
    starts = np.cumsum(lengths) - lengths
    b = np.arange(len(a)) - starts[a] + first[a]
    ticks = np.rint(np.abs(time_a[a] - time_b[b]) * _TICKS_PER_S)
    close = ticks / _TICKS_PER_S <= tolerance
    # A pair more outweighs all distances together.
    pair = len(time_a) * (round(tolerance * _TICKS_PER_S) + 1) + 1
    worth = np.where(close, pair - ticks, 0).astype(np.int64).tolist()
    bounds = zip(first.tolist(), starts.tolist(), lengths.tolist(), strict=True)
    return [(j, worth[start : start + length]) for j, start, length in bounds]


def _best_path(rows: list[Row]) -> list[tuple[int, int]]:
    """Return the pairs (row, event of b) of the greatest worth in all.

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
    """Walk back through the worths, leaving out what is not needed, the latest first.

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
