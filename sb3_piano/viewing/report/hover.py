"""What is shown of a note or a press when it is pointed at."""

from __future__ import annotations

from sb3_piano.music import FINGER_NAMES
from sb3_piano.viewing.report.judgement import DueNotes, Fate, PlayedPresses, Verdict
from sb3_piano.viewing.report.keyboard import note_name
from sb3_piano.viewing.report.marks import PRESS_MARKS

HOVER_TEMPLATE = (
    "<b>%{customdata[0]}</b>  %{customdata[1]}<br>"
    "finger due: %{customdata[2]}<br>finger nearest: %{customdata[3]}<br>"
    "onset due: %{customdata[4]}<br>onset played: %{customdata[5]}<br>"
    "error: %{customdata[6]}<extra></extra>"
)
"""How plotly puts the seven texts of a note or press together."""

_NOTHING = "\N{EN DASH}"
_RESULTS = {
    Fate.HIT: "hit",
    Fate.MISSED: "missed",
    Fate.NOT_REACHED: "not reached, the episode had ended",
}


def texts_of_notes(notes: DueNotes, presses: PlayedPresses) -> list[list[str]]:
    """Return what is shown when a note is pointed at: seven texts for each."""
    return [
        _text(notes, note, presses, press, _result(presses, press, Fate(fate)))
        for note, (press, fate) in enumerate(
            zip(notes.press.tolist(), notes.fate.tolist(), strict=True)
        )
    ]


def texts_of_presses(notes: DueNotes, presses: PlayedPresses) -> list[list[str]]:
    """Return what is shown when a press is pointed at: seven texts for each."""
    return [
        _text(notes, note, presses, press, PRESS_MARKS[Verdict(verdict)].name)
        for press, (note, verdict) in enumerate(
            zip(presses.note.tolist(), presses.verdict.tolist(), strict=True)
        )
    ]


def _result(presses: PlayedPresses, press: int, fate: Fate) -> str:
    """Say what became of a note; a missed one may have been struck all the same."""
    if fate == Fate.MISSED and press >= 0:
        return f"missed, struck {PRESS_MARKS[Verdict(presses.verdict[press])].name}"
    return _RESULTS[fate]


def _text(notes: DueNotes, note: int, presses: PlayedPresses, press: int, result: str) -> list[str]:
    """Return the texts of a note and the press that belongs to it; either may be -1, not both."""
    key = notes.key[note] if note >= 0 else presses.key[press]
    due = played = error = due_finger = nearest = _NOTHING
    if note >= 0:
        due, due_finger = f"{notes.onset[note]:.3f} s", _finger_name(notes.finger[note])
    if press >= 0:
        played, nearest = f"{presses.onset[press]:.3f} s", _finger_name(presses.finger[press])
    if note >= 0 and press >= 0:
        error = f"{1000 * (presses.onset[press] - notes.onset[note]):+.0f} ms"
    return [note_name(int(key)), result, due_finger, nearest, due, played, error]


def _finger_name(finger: int) -> str:
    return FINGER_NAMES[finger] if finger >= 0 else "not said"
