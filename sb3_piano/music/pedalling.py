"""Choose when the pedal goes down and up, from the notes alone.

The rule is legato pedalling, also called syncopated: the pedal comes up when the harmony changes,
as the new notes are struck, and goes down again shortly after, so that it joins the harmonies and
never mixes two (J. Banowetz, The Pianist's Guide to Pedaling, 1985). It comes up at rests, too. In
performances of B. Repp's pianists (Pedal timing and tempo in expressive piano performance, 1996) it
goes up within some 50 ms of the strikes and down about 100 to 200 ms after them.

Harmonies are found as by B. Pardo and W. Birmingham (Algorithms for Chordal Analysis, 2002): each
stretch of the score is compared with templates of chords, by the time for which notes sound that
are in the template, less that of notes that are not; the best sequence of chords, with a cost for
each change, is found by dynamic programming.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.music.note import Pedal
from sb3_piano.music.score import Score

Pedalling = Literal["score", "none", "auto"]
"""The score's pedal, none, or the score's if it has one, and else :func:`legato_pedal`."""

_CHORDS = (
    (0, 4, 7),
    (0, 3, 7),
    (0, 4, 7, 10),
    (0, 3, 7, 10),
    (0, 4, 7, 11),
    (0, 3, 6),
    (0, 3, 6, 9),
)
"""Major, minor, dominant seventh, minor seventh, major seventh, diminished, diminished seventh."""
_SPARE = 0.02
"""Cost of each note of a template, s for a second of music: of two that fit, the smaller counts."""
_CHANGE = 0.4
"""Cost of a change of harmony, as seconds of one note that is not in the chord."""
_FOREIGN = 1.5
"""Cost of a second of a note that is not in the chord; one that is has -1."""
_BASS = 2.0
"""Weight of the lowest note, relative to the others."""
_DOWN = 0.1
"""Time from the strikes of a new harmony until the pedal goes down, s."""
_REST = 0.3
"""Silence of all keys from which on the pedal comes up, s."""
_SHORTEST = 0.15
"""Shortest time for which the pedal is down, s."""


def pedalled(score: Score, pedal: Pedalling) -> Score:
    """Return the score with the pedal that is asked for; the score itself if it has that."""
    if pedal == "none" and score.pedals:
        return replace(score, pedals=())
    if pedal == "auto" and not score.pedals:
        return replace(score, pedals=legato_pedal(score))
    return score


def legato_pedal(score: Score) -> tuple[Pedal, ...]:
    """Return a pedal for the score by the rule of this module."""
    onsets = np.unique([note.onset for note in score.notes])
    changes = onsets[_changes(score, onsets)]
    ends = np.append(changes[1:], max(note.offset for note in score.notes))
    pedals = []
    for start, end in zip(changes.tolist(), ends.tolist(), strict=True):
        for down, up in _without_rests(score, start, end):
            if up - down - _DOWN >= _SHORTEST:
                pedals.append(Pedal(onset=down + _DOWN, offset=up))
    return tuple(pedals)


def _without_rests(score: Score, start: float, end: float) -> list[tuple[float, float]]:
    """Split a harmony at its rests into spans, s."""
    spans, begun, silent = [], start, start
    for note in score.notes:
        if note.onset >= end:
            break
        if note.offset <= start:
            continue
        if note.onset - silent > _REST and note.onset > start:
            spans.append((begun, silent))
            begun = note.onset
        silent = max(silent, note.offset)
    return [*spans, (begun, end if end - silent <= _REST else silent)]


def _changes(score: Score, onsets: FloatArray) -> IntArray:
    """Return the indices of the onsets at which the harmony changes, the first one included."""
    cost = _costs(score, onsets)
    total, came = cost[0], np.zeros(cost.shape, dtype=int)
    for step in range(1, len(cost)):
        best = int(total.argmin())
        stays = total <= total[best] + _CHANGE
        came[step] = np.where(stays, np.arange(len(total)), best)
        total = np.where(stays, total, total[best] + _CHANGE) + cost[step]
    chord = np.zeros(len(cost), dtype=int)
    chord[-1] = int(total.argmin())
    for step in range(len(cost) - 1, 0, -1):
        chord[step - 1] = came[step, chord[step]]
    return np.concatenate([[0], np.flatnonzero(np.diff(chord)) + 1])


def _costs(score: Score, onsets: FloatArray) -> FloatArray:
    """Compute the cost of each chord between each onset and the next one, (n, chords) s."""
    bounds = np.append(onsets, max(note.offset for note in score.notes))
    weight, lowest = np.zeros((len(onsets), 12)), np.full(len(onsets), 128)
    bass = np.zeros(len(onsets))
    for note in score.notes:
        first, stop = np.searchsorted(bounds[:-1], (note.onset, note.offset))
        here = slice(int(first), max(int(stop), int(first) + 1))
        share = np.minimum(bounds[1:][here], note.offset) - np.maximum(onsets[here], note.onset)
        weight[here, note.pitch % 12] += share
        lower = note.pitch < lowest[here]
        bass[here] = np.where(lower, share, bass[here])
        lowest[here] = np.minimum(lowest[here], note.pitch)
    weight[np.arange(len(onsets)), lowest % 12] += (_BASS - 1) * bass
    templates = np.zeros((len(_CHORDS), 12, 12))
    for kind, chord in enumerate(_CHORDS):
        for root in range(12):
            templates[kind, root, [(root + step) % 12 for step in chord]] = 1.0
    flat = templates.reshape(-1, 12)
    spare = _SPARE * flat.sum(axis=1) * np.diff(bounds)[:, None]
    return np.asarray(_FOREIGN * weight @ (1 - flat.T) - weight @ flat.T + spare)
