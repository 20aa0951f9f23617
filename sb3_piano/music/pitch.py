"""Names of pitches: ``C4`` is middle C, ``F#5``, ``Bb3``; double accidentals can be read."""

from __future__ import annotations

import re

from sb3_piano.exceptions import ScoreError

SEMITONES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_ACCIDENTALS = {"": 0, "#": 1, "##": 2, "b": -1, "bb": -2}
_PITCH = re.compile(r"([A-G])(|##?|bb?)(-?\d)")
_NAMES = ("C", "C#", "D", "Eb", "E", "F", "F#", "G", "Ab", "A", "Bb", "B")


def pitch_number(name: str) -> int:
    """Parse the name of a MIDI pitch, 60 for ``"C4"``; it need not be on the keyboard.

    Raises:
        ScoreError: If `name` is not the name of a pitch.
    """
    match = _PITCH.fullmatch(name)
    if match is None:
        raise ScoreError(f"Pitch {name!r} is not valid: expected a name such as C4, F#5 or Bb3.")
    letter, accidental, octave = match.groups()
    return 12 * (int(octave) + 1) + SEMITONES[letter] + _ACCIDENTALS[accidental]


def pitch_name(pitch: int) -> str:
    """Return the name of a MIDI pitch in the usual spelling: ``"Eb4"`` and ``"F#4"``."""
    return f"{_NAMES[pitch % 12]}{pitch // 12 - 1}"
