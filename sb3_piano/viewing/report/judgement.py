"""Judgement of every note and every press: the piano roll's contents, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.metrics import Onsets, Presses, match_onsets, presses_of
from sb3_piano.performance import Performance


class Fate(IntEnum):
    """Outcome of a note that is due."""

    HIT = 0
    """Its key was struck within the tolerance of its onset."""
    MISSED = 1
    """It was not."""
    NOT_REACHED = 2
    """The episode ended before its onset."""


class Verdict(IntEnum):
    """Kind of a press."""

    HIT = 0
    """The strike that hits a note."""
    EARLY = 1
    """Struck too early for its note, and held until that is due."""
    LATE = 2
    """Struck while its note is due, too late to hit it, and nothing else hits it."""
    AGAIN = 3
    """Struck while its note is due, which another strike hits."""
    WRONG = 4
    """Hits nothing, and the key is due in none of the press's control steps."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DueNotes:
    """The n notes that should be played, in the order of the roll's strikes."""

    key: IntArray
    """(n,) 0-87."""
    onset: FloatArray
    """(n,) s."""
    offset: FloatArray
    """(n,) s, end of the last control step in which the note is due."""
    finger: IntArray
    """(n,) label 0-9, or -1."""
    fate: IntArray
    """(n,) a :class:`Fate` each."""
    press: IntArray
    """(n,) index of the press that hits it or, if none does, of the nearest of those that belong to
    it; -1 if there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayedPresses:
    """The n presses that were played, in the order of ``presses_of``."""

    key: IntArray
    """(n,) 0-87."""
    onset: FloatArray
    """(n,) s, when the key was struck."""
    offset: FloatArray
    """(n,) s, when it came up again."""
    finger: IntArray
    """(n,) finger 0-9 nearest when the key was struck, or -1."""
    verdict: IntArray
    """(n,) a :class:`Verdict` each."""
    note: IntArray
    """(n,) index of the note that the press hits or, unless it is wrong, belongs to; -1 if none."""


def judge(performance: Performance) -> tuple[DueNotes, PlayedPresses]:
    """Say of each note that is due what became of it, and of each press what it was.

    Which strike hits which note is what onset F1 counts (:func:`~sb3_piano.metrics.match_onsets`);
    as there, only notes that are due before the episode ended can be hit or missed. A press that
    hits none belongs to the note of its key that is due in one of the press's control steps; of
    several, to the one whose onset is nearest to the strike.
    """
    roll = performance.roll
    due, played = presses_of(roll.active), performance.presses
    reached = due.first < len(performance)
    began = np.flatnonzero(reached)
    pairs = match_onsets(
        Onsets(roll.onset_time[began], due.key[began]),
        Onsets(performance.strike_time, played.key),
    )
    hit = np.zeros(len(due.key), dtype=bool)
    hit[began[pairs[:, 0]]] = True
    note = _overlapped(due, played, roll.onset_time, performance.strike_time)
    note[pairs[:, 1]] = began[pairs[:, 0]]
    notes = DueNotes(
        key=due.key,
        onset=roll.onset_time,
        offset=due.end * np.float64(roll.control_timestep),
        finger=roll.finger[due.first, due.key].astype(int),
        fate=np.where(hit, Fate.HIT, np.where(reached, Fate.MISSED, Fate.NOT_REACHED)),
        press=_own_presses(note, roll.onset_time, performance.strike_time, pairs),
    )
    presses = PlayedPresses(
        key=played.key,
        onset=performance.strike_time,
        offset=performance.release_time,
        finger=performance.press_finger[played.first, played.key].astype(int),
        verdict=_verdicts(performance.strike_time, note, notes, pairs[:, 1]),
        note=note,
    )
    return notes, presses


def _overlapped(
    due: Presses, played: Presses, due_time: FloatArray, strike_time: FloatArray
) -> IntArray:
    """Return for each press the nearest note that is due in one of its control steps, or -1."""
    of_key: dict[int, list[int]] = {}
    for i, key in enumerate(due.key.tolist()):
        of_key.setdefault(key, []).append(i)
    note = np.full(len(played.key), -1)
    for j, key in enumerate(played.key.tolist()):
        near = np.array(of_key.get(key, []), dtype=np.intp)
        near = near[(due.first[near] < played.end[j]) & (played.first[j] < due.end[near])]
        if len(near):
            note[j] = near[np.abs(due_time[near] - strike_time[j]).argmin()]
    return note


def _own_presses(
    note: IntArray, due_time: FloatArray, strike_time: FloatArray, pairs: IntArray
) -> IntArray:
    """Return for each note the press that hits it, else the nearest that belongs to it, or -1."""
    press = np.full(len(due_time), -1)
    belongs = np.flatnonzero(note >= 0)
    distance = np.abs(strike_time[belongs] - due_time[note[belongs]])
    farthest_first = belongs[np.argsort(-distance, kind="stable")]
    press[note[farthest_first]] = farthest_first  # of several, the last one stays
    press[note[pairs[:, 1]]] = pairs[:, 1]
    return press


def _verdicts(strike_time: FloatArray, note: IntArray, notes: DueNotes, hits: IntArray) -> IntArray:
    verdict = np.full(len(note), int(Verdict.WRONG))
    belongs = np.flatnonzero(note >= 0)
    own = note[belongs]
    verdict[belongs] = np.where(notes.fate[own] == Fate.HIT, Verdict.AGAIN, Verdict.LATE)
    verdict[belongs[strike_time[belongs] < notes.onset[own]]] = Verdict.EARLY
    verdict[hits] = Verdict.HIT
    return verdict
