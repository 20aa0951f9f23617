"""Choose the tempo for writing a score: 1.3 s may be a bar of 2/4 at 92, or of 4/4 at 184."""

from __future__ import annotations

import math

import numpy as np

from sb3_piano.music.score import Score

DEFAULT_TEMPO = 120.0
"""Default quarter notes a minute."""

_METERS = (2.0, 3.0, 4.0, 1.5, 4.5, 6.0)
"""Quarter notes in a bar: 2/4, 3/4, 4/4, 3/8, 9/8 and 12/8."""

_GRIDS = ((1, 0.0), (2, 1.0), (4, 2.0), (3, 2.5), (6, 3.5))
"""Divisions of a quarter note at which notes begin, and the reading effort of each."""


def likely_tempo(score: Score) -> float:
    """Choose a tempo near 100 in which most notes begin at simple parts of a quarter note.

    It is 120 if bars are unknown or differ in length.
    """
    bars, onsets = np.array(score.bars), np.array([note.onset for note in score.notes])
    lengths = np.diff(bars)
    if len(lengths) == 0 or np.ptp(lengths) > 0.004:  # s
        return DEFAULT_TEMPO
    length = float(lengths.mean())
    before = bars[np.maximum(np.searchsorted(bars, onsets, side="right") - 1, 0)]
    places = (onsets - before) / length

    def effort(quarters: float) -> float:
        at = places * quarters
        costs = [np.full(len(at), 5.0)]
        for parts, cost in _GRIDS:
            costs.append(np.where(np.abs(at - np.round(at * parts) / parts) < 0.02, cost, 5.0))
        unusual = abs(math.log(60 * quarters / length / 100))
        return float(np.min(costs, axis=0).mean()) + 2.5 * unusual

    tempo = round(60 * min(_METERS, key=effort) / length, 6)
    return tempo if 40 <= tempo <= 208 else DEFAULT_TEMPO
