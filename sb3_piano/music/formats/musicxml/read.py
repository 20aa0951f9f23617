"""Reading MusicXML, the format of notation programs.

Both the plain (``.musicxml``, ``.xml``) and the compressed form (``.mxl``) are read.
"""

from __future__ import annotations

import bisect
import itertools
import os
import re
import statistics
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from operator import attrgetter
from pathlib import Path

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.files import read_file
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.common import LeftOut
from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.musicxml.document import MOST_BYTES
from sb3_piano.music.formats.musicxml.notes import SourceNote
from sb3_piano.music.formats.musicxml.source import SourcePart, parse_document
from sb3_piano.music.formats.musicxml.timing import Timeline, timeline
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import reading

_KEYBOARDS = re.compile(
    r"piano|pno|klavier|clavier|clavecin|cembalo|harpsichord|keyboard|organ|orgel|celesta", re.I
)

_GRACE = Fraction(1, 10)
"""Longest duration of a grace note, s."""

_MOST_TIES = 16
"""How many voices may hold a key."""

_LIFT = Fraction(1, 10)
"""Time for which the pedal is up where it is changed, s."""


def read_musicxml(path: str | os.PathLike[str]) -> Score:
    """Read a MusicXML file; its name without the suffix becomes the title.

    - *Time*: by the tempo marks, 120 quarter notes a minute until the first, and the signs of
      swing; fermatas and words change nothing. Repeats, endings, D.C. and D.S. are played. A grace
      note is played before the beat, for 0.1 s, or less where that would take more than half of
      the time since the last note. A note with a staccato dot is held for half of its time. Trills
      and arpeggios are played as the plain notes that are written.
    - *Hands*: of a part with two staves, the upper is the right hand's; of two parts with one
      staff, likewise. A lone staff is a hand's if its name says so, or if it has fingerings; then
      the clef decides. Of a substitution (``4-1``) the first finger is taken.
    - *Pedal*: by its marks, or the sound that stands with them. Where it is changed it is up for
      0.1 s.
    - *Velocity*: by the ``dynamics`` of each note, which programs write from playback, 80 without;
      the signs (``mf``) are not played.
    - *Parts*: one or two. Of more, and of a singer or player with a piano, only the parts of
      keyboard instruments are read, with a warning that names the others.

    Raises:
        ScoreError: If there is no such file, it is not MusicXML, there
            are more parts than a pianist plays, or no note remains.
        ScoreWarning: Is warned if notes or parts were left out.
    """
    path = Path(path)
    left_out = LeftOut()
    with reading(path, "MusicXML file", "a complete one"):
        parts, marks = parse_document(read_file(path, MOST_BYTES))
        played = _played_parts(parts, path)
        score = _score(played, timeline(marks), path, left_out)
    left_out.warn(path)
    others = [repr(part.name) for part in parts if part.notes and part not in played]
    if others:
        text = f"Reading {str(path)!r} left out {', '.join(others)}: only the piano is read."
        warnings.warn(text, ScoreWarning, stacklevel=2)
    return score


def _played_parts(parts: Sequence[SourcePart], path: Path) -> list[SourcePart]:
    """Return the parts that are the pianist's."""
    sounding = [part for part in parts if part.notes]
    if not sounding:
        raise ScoreError(f"MusicXML file {str(path)!r} has no notes with a pitch.")
    played = [p for p in sounding if p.staves > 1 or _KEYBOARDS.search(p.name)] or sounding
    if len(played) > 2 or (len(played) == 2 and any(part.staves > 1 for part in played)):
        names = ", ".join(repr(part.name) for part in played)
        raise ScoreError(
            f"{str(path)!r} has {len(played)} parts ({names}): expected one or two, or one whose "
            "name or two staves make it the piano's. A notation program can join or remove parts."
        )
    return played


def _score(parts: Sequence[SourcePart], line: Timeline, path: Path, left_out: LeftOut) -> Score:
    played = [
        (note, of_staff.get(note.staff))
        for part, of_staff in zip(parts, _hands_of_staves(parts), strict=True)
        for note in _with_grace_times(_tied_notes(part.notes, line))
    ]
    # Grace notes before the first beat take their time from nobody, so that everything waits.
    wait = -min([Fraction(0), *(note.start for note, _ in played)])
    notes = [
        _note(note, wait, hand)
        for note, hand in played
        if left_out.is_playable(float(note.start + wait), float(note.end + wait), note.pitch)
    ]
    if not notes:
        raise ScoreError(f"MusicXML file {str(path)!r} has no notes to play{left_out.only}.")
    last = max(note.offset for note in notes)
    lines = [start + wait for at in parts[0].measures for start, _ in line.played(at, at)]
    return Score(
        notes=notes,
        pedals=[press for part in parts for press in _presses(part.pedals, line, wait)],
        title=path.stem,
        bars=sorted({float(at) for at in lines if float(at) < last}),
    )


def _note(note: SourceNote, wait: Fraction, hand: Hand | None) -> Note:
    known = hand is not None and note.fingers
    finger = finger_of(hand, note.fingers[0]) if hand is not None and known else UNKNOWN_FINGER
    return Note(
        onset=float(note.start + wait),
        offset=float(note.end + wait),
        pitch=note.pitch,
        velocity=note.velocity,
        finger=finger,
        hand=hand,
    )


def _hands_of_staves(parts: Sequence[SourcePart]) -> list[dict[int, Hand | None]]:
    """Return the hand of each staff, for each part."""
    by_name = [hand_of_name(part.name) for part in parts]
    if len(parts) == 2:
        if not any(by_name) and _middle(parts[0]) >= _middle(parts[1]):
            by_name = list(HANDS)
        return [{1: hand} for hand in by_name]
    (part,) = parts
    if part.staves == 2:
        return [{1: "right", 2: "left"}]
    if part.staves > 2:
        return [{}]
    fingered = any(note.fingers for note in part.notes)
    by_clef: Hand = "left" if part.clef == "F" else "right"
    return [{1: by_name[0] or (by_clef if fingered else None)}]


def _middle(part: SourcePart) -> float:
    return statistics.median(note.pitch for note in part.notes)


def _tied_notes(notes: Sequence[SourceNote], line: Timeline) -> list[SourceNote]:
    """Return the notes in the order of playing, in seconds, with those joined that are tied."""
    played = [
        replace(note, start=start, end=end)
        for note in notes
        for start, end in line.played(note.start, note.end, closes=note.closes)
    ]
    joined: list[SourceNote] = []
    open_ties: dict[int, list[SourceNote]] = defaultdict(list)
    struck: dict[int, Fraction] = {}
    for note in sorted(played, key=attrgetter("start")):
        if note.is_staccato and not (note.tied_on or note.tied_back):
            note.end = (note.start + note.end) / 2
        ties = open_ties[note.pitch]
        last = struck.get(note.pitch, note.start)
        whole = _tied_to(note, ties, last) if note.tied_back else None
        if whole is None:
            del ties[:-_MOST_TIES]
            struck[note.pitch] = note.start
            whole = note
            joined.append(note)
        else:
            ties.remove(whole)
            whole.end, whole.measure = max(whole.end, note.end), note.measure
        if note.tied_on:
            ties.append(whole)
    return joined


def _tied_to(note: SourceNote, ties: Sequence[SourceNote], struck: Fraction) -> SourceNote | None:
    """Return which note of its pitch, of those with an open tie, another one goes on with.

    It is the one that ends where the other begins, of the same voice if there are more; else the
    last one, over a gap of less than a measure, unless its key was ``struck`` again.
    """
    meeting = [tie for tie in ties if tie.end == note.start]
    same_voice = [tie for tie in meeting if tie.voice == note.voice]
    earlier = [
        tie
        for tie in ties
        if tie.start < note.start
        and struck < tie.end <= note.end
        and 0 <= note.measure - tie.measure <= 1
    ]
    return next(iter([*same_voice, *meeting, *reversed(earlier)]), None)


def _with_grace_times(notes: list[SourceNote]) -> list[SourceNote]:
    """Play the grace notes, which have no time of their own, before the beat."""
    onsets = sorted({note.start for note in notes if not note.grace})
    for note in notes:
        if note.grace:
            before = bisect.bisect_left(onsets, note.start) - 1
            room = (note.start - onsets[before]) / 2 if before >= 0 else note.grace_run * _GRACE
            length = min(_GRACE, room / note.grace_run)
            is_tied = note.end > note.start  # to its main note
            note.start -= note.grace * length
            note.end = note.end if is_tied else note.start + length
    return notes


def _presses(
    pedals: Sequence[tuple[Fraction, Fraction]], line: Timeline, wait: Fraction
) -> Iterator[Pedal]:
    """Yield the presses of one part, with the pedal up for a moment between two of them."""
    played = sorted(press for down, up in pedals for press in line.played(down, up))
    last_up = None
    for (down, up), after in itertools.zip_longest(played, played[1:]):
        if after is not None:  # as at a repeat sign, over which it is held
            up = min(up, after[0])
        start = down if last_up is None or down > last_up else last_up + _LIFT
        onset, offset = float(start + wait), float(up + wait)
        if offset > onset:
            last_up = up
            yield Pedal(onset=onset, offset=offset)
