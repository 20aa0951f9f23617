"""The tempo in which a score is best written, found from its bars and onsets.

A score is in seconds: 1.3 s may be a bar of 2/4 at 92 quarter notes a minute or one of 4/4 at 184.
"""

from __future__ import annotations

import math

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.music.score import Score

DEFAULT_TEMPO = 120.0
"""Quarter notes a minute where the score does not tell."""

_QUARTERS_IN_BAR = (2.0, 3.0, 4.0, 1.5, 4.5, 6.0)
"""2/4, 3/4, 4/4, 3/8, 9/8 and 12/8."""

_SLOWEST, _USUAL, _FASTEST = 40.0, 100.0, 208.0

_STEADY = 0.002
"""Largest distance of a bar line from that of a steady tempo, s."""

_GRIDS = ((1, 0.0), (2, 1.0), (4, 2.0), (3, 2.5), (6, 3.5))
"""Parts of a quarter note at which notes begin, and how much each makes a note harder to read."""

_ELSEWHERE = 5.0
"""The same of a note that begins elsewhere."""

_UNUSUAL = 2.5
"""The same of a tempo that is e times as fast, or slow, as usual."""

_NEAR = 0.02
"""Largest distance of an onset from its place, in quarter notes."""

_LEAST_SHARE = 0.9


def likely_tempo(score: Score) -> float:
    """Return the tempo, in quarter notes a minute, in which a score is best written.

    Of the usual meters the one is taken in which notes begin at quarters, eighths, sixteenths,
    triplets or sextuplets, in this order of preference, at a tempo near to 100. Where bars are
    unknown or of different lengths, or too many notes begin elsewhere, it is 120.
    """
    if len(score.bars) < 2:
        return DEFAULT_TEMPO
    first = score.bars[0]
    length = (score.bars[-1] - first) / (len(score.bars) - 1)
    if any(abs(line - first - n * length) > _STEADY for n, line in enumerate(score.bars)):
        return DEFAULT_TEMPO
    onsets, bars = np.array([note.onset for note in score.notes]), np.array(score.bars)
    # Where in its bar each note begins, in bars; below 0 before the first.
    places = (
        onsets - bars[np.maximum(np.searchsorted(bars, onsets, side="right") - 1, 0)]
    ) / length
    best, best_cost = DEFAULT_TEMPO, math.inf
    for quarters in _QUARTERS_IN_BAR:
        tempo = 60.0 * quarters / length
        costs = _reading_costs(places * quarters)
        cost = float(costs.mean()) + _UNUSUAL * abs(math.log(tempo / _USUAL))
        legible = (costs < _ELSEWHERE).mean() >= _LEAST_SHARE
        if _SLOWEST <= tempo <= _FASTEST and legible and cost < best_cost:
            best, best_cost = round(tempo, 6), cost
    return best


def _reading_costs(places: FloatArray) -> FloatArray:
    """Return how hard each note is to read, by where it begins in quarter notes: (notes,)."""
    costs = np.full(len(places), _ELSEWHERE)
    for parts, cost in reversed(_GRIDS):
        costs[np.abs(places - np.round(places * parts) / parts) < _NEAR] = cost
    return costs
