"""Classify every due note and every press, as arrays for the piano roll."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from sb3_piano.arrays import FloatArray, IntArray
from sb3_piano.metrics import Onsets, Presses, match_onsets, presses_of
from sb3_piano.performance import Performance


class Fate(IntEnum):
    """Outcome of a due note."""

    HIT = 0
    """Its key was struck within the tolerance of its onset."""
    MISSED = 1
    """Its key was not struck within the tolerance."""
    NOT_REACHED = 2
    """The episode ended before its onset."""


class Verdict(IntEnum):
    """Kind of a press."""

    HIT = 0
    """It hits a note."""
    EARLY = 1
    """Struck too early for its note, and held until the note is due."""
    LATE = 2
    """Struck while its note is due, too late to hit it; no other strike hits the note."""
    AGAIN = 3
    """Struck while its note is due, but another strike hits the note."""
    WRONG = 4
    """Hits nothing, and its key is not due in any of its control steps."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DueNotes:
    """The n due notes, in the order of the roll's strikes."""

    key: IntArray
    """(n,) 0-87."""
    onset: FloatArray
    """(n,) s."""
    offset: FloatArray
    """(n,) s, end of the last control step of the note."""
    finger: IntArray
    """(n,) label 0-9, or -1."""
    fate: IntArray
    """(n,) a :class:`Fate` each."""
    press: IntArray
    """(n,) index of the press that hits it. Without one, of the nearest press that belongs to it;
    -1 if there is none."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlayedPresses:
    """The n played presses, in the order of ``presses_of``."""

    key: IntArray
    """(n,) 0-87."""
    onset: FloatArray
    """(n,) s, time of the strike."""
    offset: FloatArray
    """(n,) s, time of the release."""
    finger: IntArray
    """(n,) finger 0-9 nearest at the strike, or -1."""
    verdict: IntArray
    """(n,) a :class:`Verdict` each."""
    note: IntArray
    """(n,) index of the note that the press hits or belongs to; -1 if none."""


def judge(performance: Performance) -> tuple[DueNotes, PlayedPresses]:
    """Classify each due note by its outcome, and each press by its kind.

    Strikes and notes are paired as for onset F1 (:func:`~sb3_piano.metrics.match_onsets`); as
    there, only notes due before the end of the episode can be hit or missed. A press that hits no
    note belongs to the note of its key that is due in one of the press's control steps; among
    several, to the one with the onset nearest to the strike.
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
    """Find for each press the nearest note that is due in one of its control steps, or -1."""
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
    """Find for each note the press that hits it, else the nearest that belongs to it, or -1."""
    press = np.full(len(due_time), -1)
    belongs = np.flatnonzero(note >= 0)
    distance = np.abs(strike_time[belongs] - due_time[note[belongs]])
    farthest_first = belongs[np.argsort(-distance, kind="stable")]
    press[note[farthest_first]] = farthest_first  # the last assignment, the nearest, stays
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
