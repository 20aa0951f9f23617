"""Read and write fingering files of the PIG data set (Nakamura, Saito and Yoshii 2020).

Each line is a note, with fields separated by white space: id, onset (s), offset (s), spelled pitch,
onset velocity, offset velocity, channel (0 right hand, 1 left hand), finger. Fingers are 1 to 5
in the right hand and -1 to -5 in the left, thumb to little. ``4_1`` is a finger changed while the
key is held; a trailing underscore is allowed. Lines that start with ``//`` are comments.
"""

from __future__ import annotations

import codecs
import functools
import math
import os
import re
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.common import LeftOut, write_score_file
from sb3_piano.music.hands import HANDS, finger_number, finger_of, likely_hand
from sb3_piano.music.note import Note, located_note
from sb3_piano.music.pitch import pitch_name, pitch_number
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import read_field, read_text

_FIELDS = "id, onset, offset, pitch, onset velocity, offset velocity, channel, finger"
_FINGER = re.compile(r"(-?)([0-5])(_(-?[0-5])?)*")
_HEAD = re.compile(
    rb"([ \t]*(//[^\r\n]*)?[\r\n])*[ \t]*\d+[ \t]+[\d.eE+-]+[ \t]+[\d.eE+-]+[ \t]+[A-Ga-g]"
)
_VERSION = "//Version: PianoFingering_v170101"
_OFFSET_VELOCITY = 80
"""The value in all files of the data set."""


def read_pig(path: str | os.PathLike[str], *, shortest: float = 0.0) -> Score:
    """Read a PIG fingering file; its name without the suffix becomes the title.

    If a finger changes, the first one is used, since it plays the onset. The sign of the finger
    gives the hand, whatever the channel. A finger that is 0 or missing is unknown; then the channel
    gives the hand. Notes off the keyboard and notes that do not end after they start are left out,
    with a warning that counts them.

    Args:
        path: The file.
        shortest: Length of a note without length, in s.

    Raises:
        ScoreError: If there is no such file, a line is malformed, or no note remains.
        ScoreWarning: If notes were left out.
    """
    path, left_out = Path(path), LeftOut()
    lines = [
        _read_line(f"Line {number} of {str(path)!r}", line.split(), left_out, shortest)
        for number, line in enumerate(read_text(path, "fingering file").splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("//")
    ]
    notes = [note for note in lines if note is not None]
    if not notes:
        raise ScoreError(
            f"Fingering file {str(path)!r} has no notes{left_out.only}: expected lines of "
            f"{_FIELDS}."
        )
    left_out.warn(path)
    return Score(notes=notes, title=path.stem)


def looks_like_pig(head: bytes) -> bool:
    """Return whether the start of a file has lines of this format: number, two times, pitch."""
    return _HEAD.match(head.removeprefix(codecs.BOM_UTF8)) is not None


def write_pig(score: Score, path: str | os.PathLike[str]) -> None:
    """Write a score as a PIG fingering file, atomically.

    Times, pitches, velocities, fingers and hands are preserved exactly. Bars and the pedal are
    lost: the format has neither. A note with a hand but no finger gets the finger 0. The format has
    no unknown hand either: such a note goes to the right hand from middle C up, and to the left
    hand below.

    Raises:
        ScoreError: If the file cannot be written.
    """
    lines = [_VERSION, *(_line(number, note) for number, note in enumerate(score.notes))]
    write_score_file(Path(path), "".join(f"{line}\n" for line in lines).encode())


def _line(number: int, note: Note) -> str:
    hand = note.hand or likely_hand(note.pitch)
    finger = 0 if note.finger == UNKNOWN_FINGER else finger_number(note.finger)
    fields = (
        number,
        repr(note.onset),
        repr(note.offset),
        pitch_name(note.pitch),
        note.velocity,
        _OFFSET_VELOCITY,
        HANDS.index(hand),
        -finger if hand == "left" else finger,
    )
    return "\t".join(str(field) for field in fields)


def _read_line(where: str, fields: list[str], left_out: LeftOut, shortest: float) -> Note | None:
    if len(fields) not in (7, 8):
        raise ScoreError(f"{where} has {len(fields)} fields: expected {_FIELDS}.")
    fields = [*fields, "0"][:8]
    read = functools.partial(read_field, where)
    hand = HANDS[read("channel", fields[6], ("0", "1").index, "0 (right hand) or 1 (left hand)")]
    onset = read("onset", fields[1], _seconds, "seconds from 0, such as 1.25")
    offset = read("offset", fields[2], _seconds, "seconds from 0, such as 1.25")
    pitch = read("pitch", fields[3], pitch_number, "a spelled pitch, such as C4, F#5, Bb3, C##4")
    finger = read("finger", fields[7], _finger, "1 to 5, -1 to -5, 0, or a change such as 4_1")
    velocity = read("onset velocity", fields[4], int, "1 to 127")
    offset = onset + shortest if offset == onset else offset
    if not left_out.is_playable(onset, offset, pitch):
        return None
    return located_note(
        where,
        onset=onset,
        offset=offset,
        pitch=pitch,
        velocity=velocity,
        finger=finger,
        hand=hand,
    )


def _seconds(text: str) -> float:
    time = float(text)
    if not (math.isfinite(time) and time >= 0):
        raise ValueError
    return time


def _finger(text: str) -> int:
    match = _FINGER.fullmatch(text)
    if match is None:
        raise ValueError
    if match[2] == "0":
        return UNKNOWN_FINGER
    return finger_of("left" if match[1] else "right", int(match[2]))
