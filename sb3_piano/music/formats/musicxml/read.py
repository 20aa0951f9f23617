"""Read MusicXML, the format of notation programs.

Both plain (``.musicxml``, ``.xml``) and compressed files (``.mxl``) are supported.
"""

from __future__ import annotations

import bisect
import itertools
import os
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
from sb3_piano.music.formats.musicxml.document import MOST_BYTES
from sb3_piano.music.formats.musicxml.notes import SourceNote
from sb3_piano.music.formats.musicxml.parts import hands_of_staves, played_parts
from sb3_piano.music.formats.musicxml.source import SourcePart, parse_document
from sb3_piano.music.formats.musicxml.timing import Timeline, timeline
from sb3_piano.music.hands import Hand, finger_of
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import reading

_GRACE = Fraction(1, 10)
"""Longest duration of a grace note, s."""

_MOST_NAMED = 8
"""Most bars that a warning names."""

_MOST_TIES = 16
"""Most voices that may hold a key."""

_LIFT = Fraction(1, 10)
"""Time for which the pedal is up at a change, s."""


def read_musicxml(path: str | os.PathLike[str], parts: Sequence[str | int] = ()) -> Score:
    """Read a MusicXML file; its name without the suffix becomes the title.

    - *Time*: by the tempo marks, 120 quarter notes a minute before the first, and by signs of
      swing; fermatas and words have no effect. Repeats, endings, D.C. and D.S. are played, also if
      they are only printed. A grace note is played before the beat, for 0.1 s, but at most for half
      of the time since the last note. A note with a staccato dot is held for half of its time.
      Trills and arpeggios are played as the plain notes that are written.
    - *Hands*: the upper of a part's two staves is the right hand; so is the upper of two parts with
      one staff. The hand of a lone staff follows from its name; if it has fingerings, else from its
      clef. The first finger of a substitution (``4-1``) counts.
    - *Pedal*: by its marks, or by the sound attributes with them; up for 0.1 s at a change.
    - *Velocity*: by the ``dynamics`` of each note, which programs write from playback, default 80;
      signs (``mf``) have no effect.
    - *Parts*: chosen by name, or by number from 1. By default, all parts of keyboard instruments
      and parts named after hands; a nameless part beside a piano on one staff is its other hand. A
      warning names the other parts. If no part looks like a piano, one or two parts are read.

    Raises:
        ScoreError: If there is no such file, it is not MusicXML, its parts
            are not one pianist's and none is chosen, or no note remains.
        ScoreWarning: If notes or parts were left out.
    """
    path = Path(path)
    left_out = LeftOut()
    with reading(path, "MusicXML file", "a complete one"):
        written, marks = parse_document(read_file(path, MOST_BYTES))
        played = played_parts(written, path, parts)
        line = timeline(marks)
        score = _score(played, line, path, left_out)
    left_out.warn(path)
    if line.unplayed:
        text = f"Reading {str(path)!r} left out {_bars(line.unplayed)}: no sign leads there."
        warnings.warn(text, ScoreWarning, stacklevel=2)
    if line.aimless:
        where = _bars(line.aimless)
        text = f"Reading {str(path)!r} did not jump in {where}: no sign is where it leads to."
        warnings.warn(text, ScoreWarning, stacklevel=2)
    others = [repr(part.name) for part in written if part.notes and part not in played]
    if others:
        what = "what was chosen is" if parts else "the piano is"
        text = f"Reading {str(path)!r} left out {', '.join(others)}: only {what} read."
        warnings.warn(text, ScoreWarning, stacklevel=2)
    return score


def _bars(numbers: Sequence[str]) -> str:
    """Return ``"bars 5, 6, 9"``, with at most the first few."""
    shown = [*numbers[:_MOST_NAMED], *(["..."] if len(numbers) > _MOST_NAMED else [])]
    return f"bar{'s' * (len(numbers) > 1)} {', '.join(shown)}"


def _score(parts: Sequence[SourcePart], line: Timeline, path: Path, left_out: LeftOut) -> Score:
    played = [
        (note, of_staff.get(note.staff))
        for part, of_staff in zip(parts, hands_of_staves(parts), strict=True)
        for note in _with_grace_times(_tied_notes(part.notes, line))
    ]
    # Nothing precedes grace notes before the first beat, so everything else is delayed.
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


def _tied_notes(notes: Sequence[SourceNote], line: Timeline) -> list[SourceNote]:
    """Return the notes in the order of playing, in seconds, with tied notes joined."""
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
    """Find the note with an open tie that a tied note continues, or None.

    Best is a note that ends where the other begins, in the same voice if possible. Otherwise it is
    the last one with a gap of less than a measure, unless its key was ``struck`` again.
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
    """Set the times of grace notes, which have no length, before the beat."""
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
    """Yield the presses of one part, with the pedal up briefly between two of them."""
    played = sorted(press for down, up in pedals for press in line.played(down, up))
    last_up = None
    for (down, up), after in itertools.zip_longest(played, played[1:]):
        if after is not None:  # it may be held over a repeat sign
            up = min(up, after[0])
        start = down if last_up is None or down > last_up else last_up + _LIFT
        onset, offset = float(start + wait), float(up + wait)
        if offset > onset:
            last_up = up
            yield Pedal(onset=onset, offset=offset)
