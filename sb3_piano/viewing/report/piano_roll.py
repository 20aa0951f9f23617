"""Contents of the piano roll: due notes and presses, grouped by mark."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sb3_piano.metrics import presses_of
from sb3_piano.music import MIN_PITCH, Note, Score
from sb3_piano.music.constants import FINGER_NAMES, NUM_KEYS
from sb3_piano.performance import Performance
from sb3_piano.viewing.report.judgement import DueNotes, Fate, PlayedPresses, Verdict
from sb3_piano.viewing.report.page import FINGERS, TOLERANCE

_PITCH_CLASSES = ("C", "C♯", "D", "D♯", "E", "F", "F♯", "G", "G♯", "A", "A♯", "B")
_NOTHING = "\N{EN DASH}"
_LABELS = ("finger due", "finger nearest", "onset due", "onset played", "error")
_SCORE_LABELS = ("finger", "onset", "offset")


class Mark(NamedTuple):
    """One kind of mark; style sheet and script define its looks, under its id."""

    id: str
    name: str
    """Its name, in lower case."""
    meaning: str
    """Its meaning, in one sentence."""


PRESS_MARKS = {
    Verdict.HIT: Mark("hit", "hit", f"Struck within {TOLERANCE} of its onset."),
    Verdict.EARLY: Mark(
        "early",
        "early",
        f"The right key, struck more than {TOLERANCE} too early and held until it is due.",
    ),
    Verdict.LATE: Mark("late", "late", f"The right key, struck more than {TOLERANCE} too late."),
    Verdict.AGAIN: Mark(
        "again", "struck again", "The right key, but its note was hit by another strike."
    ),
    Verdict.WRONG: Mark("wrong", "wrong", "A key that is not due while it is pressed."),
}
"""Marks of presses by their verdict."""

_FINGER_MARKS = tuple(
    Mark(f"due-{id_}", name, f"Due, for the {name} of either hand.")
    for id_, name in ((finger, finger.replace("-", " ")) for finger in FINGERS)
)
_ANY_FINGER = Mark(
    "due-any-finger", "any finger", "Due, and the score does not say with which finger."
)
_NOT_REACHED = Mark("not-reached", "not reached", "Due after the episode had ended.")
_MISSED = Mark("missed", "missed", f"Due, but its key was not struck within {TOLERANCE}.")
PEDAL_MARK = Mark("pedal", "pedal", "When the sustain pedal should be down.")
_DUE_MARKS = (*_FINGER_MARKS, _ANY_FINGER)

Legend = list[tuple[Mark, int]]


def note_name(key: int) -> str:
    """Return the name of a key, 0-87.

    >>> note_name(39), note_name(40)
    ('C4', 'C♯4')
    """
    octave, pitch_class = divmod(MIN_PITCH + key, 12)
    return f"{_PITCH_CLASSES[pitch_class]}{octave - 1}"


def legends(notes: DueNotes, presses: PlayedPresses) -> dict[str, Legend]:
    """Count the marks of presses and of due notes.

    Marks of notes that do not occur are left out.
    """
    verdicts = Counter(presses.verdict.tolist())
    counts = Counter(_note_marks(notes))
    missed = int((notes.fate == Fate.MISSED).sum())
    found = [(mark, counts[mark]) for mark in (*_DUE_MARKS, _NOT_REACHED)]
    return {
        "played": [(mark, verdicts[int(verdict)]) for verdict, mark in PRESS_MARKS.items()],
        "due": [(_MISSED, missed), *(pair for pair in found if pair[1])],
    }


def piano_roll(performance: Performance, notes: DueNotes, presses: PlayedPresses) -> dict[str, Any]:
    """Return the contents of the page's piano roll, with the pedal below, from ``judge``'s results.

    Returns:
        ``bars``: for each mark's id the ``key`` (0-87), ``onset`` and ``length`` [s] of its bars,
        and the hover ``texts``: pitch, result and the values of the ``labels``; ``pedal``: (onset,
        offset) [s] of the presses that were ``due``, played rightly (``hit``) and ``wrong``;
        ``keys``: names of the 88 keys; ``duration`` of the piece [s]; ``end``: end of the episode
        [s], if that is before the piece's, else ``None``.
    """
    note_texts, press_texts = _hover_texts(notes, presses)
    note_marks = np.array([mark.id for mark in _note_marks(notes)], dtype=str)
    bars = {
        mark.id: _bars(notes, note_marks == mark.id, note_texts)
        for mark in (*_DUE_MARKS, _NOT_REACHED)
        if (note_marks == mark.id).any()
    }
    for verdict, mark in PRESS_MARKS.items():
        bars[mark.id] = _bars(presses, presses.verdict == verdict, press_texts)
    bars[_MISSED.id] = _bars(notes, notes.fate == Fate.MISSED, note_texts)
    step = performance.roll.control_timestep
    return {
        "bars": bars,
        "labels": _LABELS,
        "pedal": _pedal(performance),
        "keys": [note_name(key) for key in range(NUM_KEYS)],
        "duration": performance.roll.duration,
        "end": len(performance) * step if len(performance) < len(performance.roll) else None,
    }


def piano_roll_of_score(score: Score) -> tuple[dict[str, Any], Legend]:
    """Return the contents of :func:`piano_roll` for an unplayed score, and their legend.

    The pedal is only ``due``; hover texts have pitch, hand, finger and times.
    """
    of_mark: dict[Mark, list[Note]] = {}
    for note in score.notes:
        of_mark.setdefault(_due_mark(note.finger), []).append(note)
    bars = {
        mark.id: {
            "key": [note.key for note in notes],
            "onset": [note.onset for note in notes],
            "length": [note.offset - note.onset for note in notes],
            "texts": [_score_texts(note) for note in notes],
        }
        for mark, notes in of_mark.items()
    }
    contents = {
        "bars": bars,
        "labels": _SCORE_LABELS,
        "pedal": {"due": [(pedal.onset, pedal.offset) for pedal in score.pedals]},
        "keys": [note_name(key) for key in range(NUM_KEYS)],
        "duration": score.duration,
        "end": None,
    }
    return contents, [(mark, len(of_mark[mark])) for mark in _DUE_MARKS if mark in of_mark]


def _score_texts(note: Note) -> list[str]:
    hand = "" if note.hand is None else f"{note.hand} hand"
    times = [f"{time:.3f} s" for time in (note.onset, note.offset)]
    return [note_name(note.key), hand, _finger_name(note.finger), *times]


def _due_mark(finger: int) -> Mark:
    return _FINGER_MARKS[finger % len(FINGERS)] if finger >= 0 else _ANY_FINGER


def _note_marks(notes: DueNotes) -> list[Mark]:
    return [
        _NOT_REACHED if fate == Fate.NOT_REACHED else _due_mark(finger)
        for finger, fate in zip(notes.finger.tolist(), notes.fate.tolist(), strict=True)
    ]


def _bars(
    what: DueNotes | PlayedPresses, chosen: np.ndarray, texts: Sequence[Sequence[str]]
) -> dict[str, Any]:
    return {
        "key": what.key[chosen],
        "onset": what.onset[chosen],
        "length": (what.offset - what.onset)[chosen],
        "texts": [texts[i] for i in np.flatnonzero(chosen).tolist()],
    }


def _pedal(performance: Performance) -> dict[str, np.ndarray]:
    """Return (n, 2) onsets and offsets [s] of due, right and wrong presses of the pedal."""
    due, played = performance.roll.sustain, performance.sustain
    rightly = played & due[: len(played)]
    rows = {}
    for name, down in (("due", due), ("hit", rightly), ("wrong", played & ~rightly)):
        spans = presses_of(down[:, None])
        step = performance.roll.control_timestep
        rows[name] = np.stack([spans.first, spans.end], axis=1) * step
    return rows


def _hover_texts(
    notes: DueNotes, presses: PlayedPresses
) -> tuple[list[list[str]], list[list[str]]]:
    """Make the texts of each note and each press: pitch, result, fingers, times, error."""

    def texts(note: int, press: int, result: str) -> list[str]:
        """Make the texts of a note and the press that belongs to it; one of them may be -1."""
        key = notes.key[note] if note >= 0 else presses.key[press]
        due = played = error = due_finger = nearest = _NOTHING
        if note >= 0:
            due, due_finger = f"{notes.onset[note]:.3f} s", _finger_name(notes.finger[note])
        if press >= 0:
            played, nearest = f"{presses.onset[press]:.3f} s", _finger_name(presses.finger[press])
        if note >= 0 and press >= 0:
            error = f"{1000 * (presses.onset[press] - notes.onset[note]):+.0f} ms"
        return [note_name(int(key)), result, due_finger, nearest, due, played, error]

    verdicts = [PRESS_MARKS[Verdict(verdict)].name for verdict in presses.verdict]
    results = {Fate.HIT: "hit", Fate.MISSED: "missed"}
    results[Fate.NOT_REACHED] = "not reached, the episode had ended"
    of_notes = []
    for note, press in enumerate(notes.press.tolist()):
        fate = Fate(notes.fate[note])
        struck = fate == Fate.MISSED and press >= 0  # too early or too late
        result = f"missed, struck {verdicts[press]}" if struck else results[fate]
        of_notes.append(texts(note, press, result))
    owners = enumerate(presses.note.tolist())
    return of_notes, [texts(note, press, verdicts[press]) for press, note in owners]


def _finger_name(finger: int) -> str:
    return FINGER_NAMES[finger] if finger >= 0 else "not said"
