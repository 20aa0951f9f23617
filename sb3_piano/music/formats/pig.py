"""Fingering files of the PIG data set (Piano fInGering; Nakamura, Saito and Yoshii 2020).

A line is one note, its fields separated by white space: id, onset (s), offset (s), spelled pitch,
onset velocity, offset velocity, channel (0 right hand, 1 left hand), finger. Fingers are 1 to 5
in the right hand and -1 to -5 in the left, thumb to little; ``4_1`` is a finger changed while the
key is held. Lines that start with ``//`` are comments.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.note import Note, located_note
from sb3_piano.music.pitch import pitch_number
from sb3_piano.music.score import Score

_FIELDS = "id, onset, offset, pitch, onset velocity, offset velocity, channel, finger"
_FINGER = re.compile(r"(-?[0-5])(_-?[0-5])*")


def read_pig(path: str | os.PathLike[str]) -> Score:
    """Read a PIG fingering file; its name without the suffix becomes the title.

    Of a changed finger the first is taken, since it plays the onset. The sign of the finger
    decides the hand, whatever the channel. A finger that is 0 or missing is unknown.

    Raises:
        ScoreError: If there is no such file, it holds no notes, or a line is malformed.
    """
    path = Path(path)
    notes = [
        _read_note(f"Line {number} of {str(path)!r}", line.split())
        for number, line in enumerate(_read_text(path).splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("//")
    ]
    if not notes:
        raise ScoreError(f"Fingering file {str(path)!r} has no notes: expected lines of {_FIELDS}.")
    return Score(notes=notes, title=path.stem)


def _read_text(path: Path) -> str:
    if not os.path.isfile(path):
        raise ScoreError(f"There is no fingering file {str(path)!r}: expected an existing file.")
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ScoreError(
            f"Cannot read {str(path)!r} as a fingering file: {error}; expected UTF-8 text."
        ) from error


def _read_note(where: str, fields: list[str]) -> Note:
    if len(fields) not in (7, 8):
        raise ScoreError(f"{where} has {len(fields)} fields: expected {_FIELDS}.")
    _, onset, offset, pitch, velocity, _, channel, *finger = fields
    if channel not in ("0", "1"):
        raise _bad_field("channel", channel, where, "0 (right hand) or 1 (left hand)")
    return located_note(
        where,
        onset=_read_time("onset", onset, where),
        offset=_read_time("offset", offset, where),
        pitch=_read_pitch(pitch, where),
        velocity=_read_velocity(velocity, where),
        finger=_read_finger(finger[0], where) if finger else UNKNOWN_FINGER,
    )


def _read_time(name: str, text: str, where: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise _bad_field(name, text, where, "seconds, such as 1.25") from error


def _read_pitch(text: str, where: str) -> int:
    try:
        return pitch_number(text)
    except ScoreError as error:
        raise _bad_field(
            "pitch", text, where, "a spelled pitch, such as C4, F#5, Bb3, C##4"
        ) from error


def _read_velocity(text: str, where: str) -> int:
    if not text.isdecimal():
        raise _bad_field("onset velocity", text, where, "1 to 127")
    return int(text)


def _read_finger(text: str, where: str) -> int:
    match = _FINGER.fullmatch(text)
    if match is None:
        raise _bad_field("finger", text, where, "1 to 5, -1 to -5, 0, or a change such as 4_1")
    number = int(match[1])
    if number == 0:
        return UNKNOWN_FINGER
    return number - 1 if number > 0 else 4 - number


def _bad_field(name: str, text: str, where: str, expected: str) -> ScoreError:
    return ScoreError(f"{where}: {name} {text!r} is not valid: expected {expected}.")
