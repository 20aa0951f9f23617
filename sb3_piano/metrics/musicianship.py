"""Musicianship: endings, loudness, chords, timing, legato and pedal of a performance."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray, IntArray
from sb3_piano.metrics.onsets import IntPairs, Onsets, OnsetScores, match_onsets, rounded_distance
from sb3_piano.music.hands import HANDS, likely_hand
from sb3_piano.music.note import Pedal
from sb3_piano.music.score import Score

OFFSET_TOLERANCE, OFFSET_SHARE = 0.05, 0.2
"""Greatest distance of a note's end: s, and share of the due duration; the greater one counts."""
VELOCITY_TOLERANCE = 0.1
"""Greatest distance of rescaled velocities, as a share of the range of the due ones."""
TOGETHER = 0.03
"""Notes due within this time of the first of them are a chord, s."""
TOUCHING = 0.02
"""Notes touch if the second is due within this time of the end of the first, s."""
PEDAL_TOLERANCE = 0.1
"""Greatest distance of a press or a release of the pedal, s."""
WINDOW, HOP, LEAST_HITS = 2.0, 1.0, 4
"""Windows of the local tempo: length and distance, s; hits that one needs."""

_MS = 1000.0
_NONE = math.nan


class _Notes(NamedTuple):
    """Notes in order of onset, then key, without overlaps on a key."""

    key: IntArray
    onset: FloatArray
    offset: FloatArray
    velocity: FloatArray
    hand: IntArray
    """Index in ``HANDS``."""


def musicianship(due: Score, played: Score | None) -> dict[str, float]:
    """Compare a performance with its score as a musician would; NaN where undefined.

    A *hit* is a pair of :func:`~sb3_piano.metrics.match_onsets`: a due note and a strike of its
    key within 50 ms. A note ends no later than its key is struck again; notes struck on one key at
    one time are one. Notes without a hand belong to the one that is nearer to middle C.

    - ``note_offset_f1``: F1 as ``onset_f1``, where pairs also end within 50 ms or 20 % of the due
      duration of each other. Source: ``mir_eval.transcription``.
    - ``sounding_offset_f1``: the same, with notes that the pedal prolongs to its release or the
      key's next strike, on both sides.
    - ``note_velocity_f1``: F1 of those hits whose velocity is right: due velocities scaled to
      [0, 1], played ones fitted to them by least squares over the hits, less than 0.1 apart. It is
      undefined if all due velocities are equal. Source: ``mir_eval.transcription_velocity``
      (Hawthorne et al. 2018, Onsets and Frames); ``note_offset_velocity_f1``: with endings.
    - ``velocity_correlation``, ``..._right``, ``..._left``: Pearson's of due and played velocity
      over the hits; undefined where one is constant.
    - ``velocity_bias``, ``velocity_std``: mean of played less due velocity, and standard deviation
      of the played ones, over the hits.
    - ``chord_spread_ms``: time between first and last strike of a chord, mean over the chords of at
      least two hits; a chord are the notes due within 30 ms of its first. ``chord_order``: share of
      the pairs of a chord's hits, due at different times, that are struck in that order; of those
      struck at one time, half counts. ``melody_lead_ms``: by how much the highest hit is struck
      before the mean of the others, mean over chords. Source: Goebl 2001, Melody lead in piano
      performance: expressive device or artifact?
    - ``onset_error_mean_right_ms``, ``onset_error_std_right_ms``, and ``..._left``: mean and
      standard deviation of the hits' delay.
    - ``tempo_error``: in windows of 2 s, one each second, with four hits at two times or more, the
      slope of the strikes' times over the due times by least squares; mean of its distance from 1.
    - ``duration_ratio``: median of played over due duration of the hits.
    - ``legato_overlap_ms``: release of a note less the strike of the next one, median over pairs of
      hits of one hand that touch in the score (within 20 ms), on two keys; a note's next is the
      nearest in pitch. Negative is a gap. Source: Repp 1995, Acoustics, perception, and production
      of legato articulation on a digital piano ("key overlap time").
    - ``pedal_f1``: twice the time in which the pedal is down and should be, over the sum of the two
      times; ``pedal_action_f1``: F1 of its presses and releases within 100 ms. Both are undefined
      if the score has no pedal. ``pedal_share``: share of the score's time with the pedal down.

    Args:
        due: The score.
        played: The performance on the same time axis; ``None`` if no key was pressed.
    """
    target, strikes = _notes_of(due), _notes_of(played)
    pairs = match_onsets(_onsets(target), _onsets(strikes))
    a, b = _taken(target, pairs[:, 0]), _taken(strikes, pairs[:, 1])
    ends = _match_endings(target, strikes)
    pedals, pressed = due.pedals, played.pedals if played is not None else ()
    sounding = _match_endings(_prolonged(target, pedals), _prolonged(strikes, pressed))
    loud = np.ptp(target.velocity) > 0

    def f1(hits: int) -> float:
        return OnsetScores.of_counts(hits, len(strikes.key), len(target.key)).f1

    late = b.onset - a.onset
    found = {
        "note_offset_f1": f1(len(ends)),
        "sounding_offset_f1": f1(len(sounding)),
        "note_velocity_f1": f1(_equally_loud(target, strikes, pairs)) if loud else _NONE,
        "note_offset_velocity_f1": f1(_equally_loud(target, strikes, ends)) if loud else _NONE,
        "velocity_correlation": _correlation(a.velocity, b.velocity),
        "velocity_bias": _mean(b.velocity - a.velocity),
        "velocity_std": float(b.velocity.std()) if len(pairs) else _NONE,
        **_of_chords(a, b),
        "tempo_error": _tempo_error(a.onset, b.onset),
        "duration_ratio": _median((b.offset - b.onset) / (a.offset - a.onset)),
        "legato_overlap_ms": _MS * _median(_overlaps(a, b)),
        **_of_pedal(pedals, pressed, due.duration),
    }
    for index, hand in enumerate(HANDS):
        own = a.hand == index
        found[f"velocity_correlation_{hand}"] = _correlation(a.velocity[own], b.velocity[own])
        found[f"onset_error_mean_{hand}_ms"] = _MS * _mean(late[own])
        found[f"onset_error_std_{hand}_ms"] = _MS * float(late[own].std()) if own.any() else _NONE
    return {name: found[name] for name in MUSICIANSHIP}


MUSICIANSHIP = (
    "note_offset_f1",
    "sounding_offset_f1",
    "note_velocity_f1",
    "note_offset_velocity_f1",
    "velocity_correlation",
    "velocity_correlation_right",
    "velocity_correlation_left",
    "velocity_bias",
    "velocity_std",
    "chord_spread_ms",
    "chord_order",
    "melody_lead_ms",
    "onset_error_mean_right_ms",
    "onset_error_std_right_ms",
    "onset_error_mean_left_ms",
    "onset_error_std_left_ms",
    "tempo_error",
    "duration_ratio",
    "legato_overlap_ms",
    "pedal_f1",
    "pedal_action_f1",
    "pedal_share",
)
"""Names of the numbers of :func:`musicianship`, in order."""


def _notes_of(score: Score | None) -> _Notes:
    """Return a score's notes as a key can play them."""
    notes = [] if score is None else score.notes
    rows = [
        (n.key, n.onset, n.offset, n.velocity, HANDS.index(n.hand or likely_hand(n.pitch)))
        for n in notes
    ]
    key, onset, offset, velocity, hand = np.array(rows, dtype=float).reshape(-1, 5).T
    order = np.lexsort((onset, key))
    again = np.diff(key[order]) == 0
    struck = np.where(again, onset[order][1:], np.inf)
    offset[order[:-1]] = np.minimum(offset[order[:-1]], struck)
    kept = np.flatnonzero(offset > onset)
    whole = (column[kept].astype(np.intp) for column in (key, hand))
    return _Notes(next(whole), onset[kept], offset[kept], velocity[kept], next(whole))


def _onsets(notes: _Notes) -> Onsets:
    return Onsets(notes.onset, notes.key)


def _taken(notes: _Notes, index: IntArray) -> _Notes:
    key, onset, offset, velocity, hand = notes
    return _Notes(key[index], onset[index], offset[index], velocity[index], hand[index])


def _match_endings(target: _Notes, played: _Notes) -> IntPairs:
    """Pair notes that begin and end together.

    Keeping the order of time on each key costs no pair, as its notes do not overlap: two pairs of
    one key can only be crossed if all four are so short that 50 ms is the tolerance of each end.
    """
    most = np.maximum(OFFSET_TOLERANCE, OFFSET_SHARE * (target.offset - target.onset))

    def ends(row: IntArray, column: IntArray) -> BoolArray:
        return rounded_distance(target.offset[row], played.offset[column]) <= most[row]

    return match_onsets(_onsets(target), _onsets(played), also=ends)


def _prolonged(notes: _Notes, pedals: tuple[Pedal, ...]) -> _Notes:
    """Return notes that sound until the pedal they end in is up, or their key is struck again."""
    if not pedals or not len(notes.key):
        return notes
    down, up = np.array([(pedal.onset, pedal.offset) for pedal in pedals]).T
    at = np.searchsorted(down, notes.offset, side="right") - 1
    offset = np.where(at >= 0, np.maximum(notes.offset, up[at]), notes.offset)
    order = np.lexsort((notes.onset, notes.key))
    again = np.where(np.diff(notes.key[order]) == 0, notes.onset[order][1:], np.inf)
    offset[order[:-1]] = np.minimum(offset[order[:-1]], again)
    return notes._replace(offset=offset)


def _equally_loud(target: _Notes, played: _Notes, pairs: IntPairs) -> int:
    """Count the pairs whose velocities agree after rescaling."""
    if not len(pairs):
        return 0
    low = target.velocity.min()
    scale = max(1.0, target.velocity.max() - low)
    due, struck = (target.velocity[pairs[:, 0]] - low) / scale, played.velocity[pairs[:, 1]]
    columns = np.column_stack([struck, np.ones(len(struck))])
    fitted = columns @ np.linalg.lstsq(columns, due, rcond=None)[0]
    return int(np.count_nonzero(np.abs(fitted - due) < VELOCITY_TOLERANCE))


def _of_chords(a: _Notes, b: _Notes) -> dict[str, float]:
    spreads, leads, ordered = [], [], []
    for chord in chords(a.onset):
        time, key, due = b.onset[chord], a.key[chord], a.onset[chord]
        if not np.ptp(key):
            continue
        spreads.append(np.ptp(time))
        highest = key == key.max()
        leads.append(time[~highest].mean() - time[highest].mean())
        i, j = np.triu_indices(len(chord), 1)
        told = rounded_distance(due[i], due[j]) > 0
        ordered += (0.5 + 0.5 * np.sign((due[j] - due[i]) * (time[j] - time[i])))[told].tolist()
    return {
        "chord_spread_ms": _MS * _mean(np.array(spreads)),
        "chord_order": _mean(np.array(ordered)),
        "melody_lead_ms": _MS * _mean(np.array(leads)),
    }


def chords(onset: FloatArray) -> Iterator[IntArray]:
    """Yield the indices of the notes due together, see :data:`TOGETHER`; onsets in any order."""
    order = np.argsort(onset, kind="stable")
    times, first = onset[order], 0
    while first < len(order):
        last = int(np.searchsorted(times, times[first] + TOGETHER, side="right"))
        yield order[first:last]
        first = last


def _tempo_error(due: FloatArray, played: FloatArray) -> float:
    slopes = []
    for start in np.arange(due.min(), due.max(), HOP) if len(due) else ():
        inside = (due >= start) & (due < start + WINDOW)
        if np.count_nonzero(inside) >= LEAST_HITS and np.ptp(due[inside]) > TOGETHER:
            slopes.append(np.polyfit(due[inside], played[inside], 1)[0])
    return _mean(np.abs(np.array(slopes) - 1))


def _overlaps(a: _Notes, b: _Notes) -> FloatArray:
    """Return release less next strike of touching notes, s."""
    found = []
    for i in range(len(a.key)):
        near = np.abs(a.onset - a.offset[i]) <= TOUCHING
        near &= (a.hand == a.hand[i]) & (a.key != a.key[i]) & (a.onset > a.onset[i])
        (after,) = np.nonzero(near)
        if len(after):
            j = after[np.argmin(np.abs(a.key[after] - a.key[i]))]
            found.append(b.offset[i] - b.onset[j])
    return np.array(found)


def _of_pedal(
    due: tuple[Pedal, ...], played: tuple[Pedal, ...], duration: float
) -> dict[str, float]:
    def total(pedals: tuple[Pedal, ...]) -> float:
        return sum(max(min(p.offset, duration) - p.onset, 0.0) for p in pedals)

    def actions(pedals: tuple[Pedal, ...]) -> Onsets:
        times = np.array([(pedal.onset, pedal.offset) for pedal in pedals]).reshape(-1, 2)
        return Onsets(times.ravel(), np.tile([0, 1], len(times)))

    both = sum(
        max(min(p.offset, q.offset, duration) - max(p.onset, q.onset), 0.0)
        for p in due
        for q in played
    )
    hits = len(match_onsets(actions(due), actions(played), PEDAL_TOLERANCE))
    return {
        "pedal_f1": 2 * both / (total(due) + total(played)) if total(due) else _NONE,
        "pedal_action_f1": hits / (len(due) + len(played)) if due else _NONE,
        "pedal_share": total(played) / duration,
    }


def _correlation(due: FloatArray, played: FloatArray) -> float:
    if len(due) < 2 or not (np.ptp(due) > 0 < np.ptp(played)):
        return _NONE
    return float(np.corrcoef(due, played)[0, 1])


def _of_values(statistic: Callable[[FloatArray], float]) -> Callable[[FloatArray], float]:
    return lambda values: float(statistic(values)) if len(values) else _NONE


_mean, _median = _of_values(np.mean), _of_values(np.median)
