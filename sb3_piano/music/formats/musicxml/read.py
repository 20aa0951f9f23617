"""Reading MusicXML, the format of notation programs, with partitura.

Both the plain (``.musicxml``, ``.xml``) and the compressed form (``.mxl``) are read.
"""

from __future__ import annotations

import bisect
import importlib
import os
import re
import statistics
import warnings
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.left_out import LeftOut
from sb3_piano.music.formats.midi_hands import hand_of_name
from sb3_piano.music.formats.musicxml.container import document_in
from sb3_piano.music.formats.musicxml.notes import NoteDetails
from sb3_piano.music.formats.musicxml.source import SourcePart, parse_source
from sb3_piano.music.formats.musicxml.timing import TimedPart, place_in_time
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score

_KEYBOARDS = re.compile(
    r"piano|pno|klavier|clavier|clavecin|cembalo|harpsichord|keyboard|organ|orgel|celesta", re.I
)

_GRACE = Fraction(1, 10)
"""How long a grace note lasts at most, in s."""

_LIFT = Fraction(1, 10)
"""How long the pedal is up where it is changed, in s."""


def read_musicxml(path: str | os.PathLike[str]) -> Score:
    """Read a MusicXML file; its name without the suffix becomes the title.

    - *Time*: by the tempo marks, 120 quarter notes a minute until the first; fermatas and words
      change nothing. Repeats, endings, D.C. and D.S. are played. A grace note is played before
      the beat, for 0.1 s, or less where that would take more than half of the time since the last
      note. A note with a staccato dot is held for half of its time. Trills and arpeggios are
      played as the plain notes that are written.
    - *Hands*: of a part with two staves, the upper is the right hand's; of two parts with one
      staff, likewise. A lone staff is a hand's if its name says so, or if it has fingerings; then
      the clef decides. Of a substitution (``4-1``) the first finger is taken.
    - *Pedal*: by its marks. Where it is changed it is up for 0.1 s.
    - *Velocity*: by the ``dynamics`` of each note, which programs write from playback, 80 without;
      the signs (``mf``) are not played.
    - *Parts*: one or two. Of more, and of a singer or player with a piano, only the parts of
      keyboard instruments are read, with a warning that names the others.

    Raises:
        ScoreError: If partitura is not installed, there is no such file, it is not MusicXML, there
            are more parts than a pianist plays, or no note remains.
        ScoreWarning: Is warned if notes or parts were left out.
    """
    path = Path(path)
    require_partitura()
    content = _content(path)
    try:
        parts, document = parse_source(document_in(content))
        played = _played_parts(parts, path)
        timed = place_in_time(document)
        left_out = LeftOut()
        score = _score([(parts[i], timed[i]) for i in played], path, left_out)
    except ScoreError:
        raise
    except Exception as error:
        # A damaged file surfaces as whatever the parsers happen to stumble over.
        raise ScoreError(
            f"Cannot read {str(path)!r} as MusicXML ({str(error) or type(error).__name__}): "
            "expected a complete partwise MusicXML file."
        ) from error
    left_out.warn(path)
    others = [repr(part.name) for i, part in enumerate(parts) if part.notes and i not in played]
    if others:
        text = f"Reading {str(path)!r} left out {', '.join(others)}: only the piano is read."
        warnings.warn(text, ScoreWarning, stacklevel=2)
    return score


def require_partitura() -> None:
    """Raise an error that says what to install unless partitura is.

    Raises:
        ScoreError: If partitura cannot be imported.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about modules that its parsers import
            importlib.import_module("partitura")
    except ImportError as error:
        raise ScoreError(
            "MusicXML needs the package partitura, which is not installed: "
            "pip install 'sb3-piano[musicxml]'"
        ) from error


def _content(path: Path) -> bytes:
    if not os.path.isfile(path):
        raise ScoreError(f"There is no MusicXML file {str(path)!r}: expected an existing file.")
    try:
        return path.read_bytes()
    except OSError as error:
        raise ScoreError(f"Cannot read {str(path)!r}: {error.strerror}.") from error


def _played_parts(parts: Sequence[SourcePart], path: Path) -> list[int]:
    """Return the indices of the parts that are the pianist's."""
    sounding = [i for i, part in enumerate(parts) if part.notes]
    if not sounding:
        raise ScoreError(f"MusicXML file {str(path)!r} has no notes with a pitch.")
    pianos = [i for i in sounding if parts[i].staves > 1 or _KEYBOARDS.search(parts[i].name)]
    played = pianos or sounding
    if len(played) > 2 or (len(played) == 2 and any(parts[i].staves > 1 for i in played)):
        names = ", ".join(repr(parts[i].name) for i in played)
        raise ScoreError(
            f"{str(path)!r} has {len(played)} parts ({names}): expected one or two, or one whose "
            "name or two staves make it the piano's. A notation program can join or remove parts."
        )
    return played


def _score(parts: list[tuple[SourcePart, TimedPart]], path: Path, left_out: LeftOut) -> Score:
    hands = _hands_of_staves([source for source, _ in parts])
    played = [
        (start, end, note, hand)
        for (source, timed), of_staff in zip(parts, hands, strict=True)
        for start, end, note in _with_grace_times(_tied_notes(source, timed))
        for hand in [of_staff.get(note.staff)]
    ]
    # Grace notes before the first beat take their time from nobody, so that everything waits.
    wait = -min([Fraction(0), *(start for start, *_ in played)])
    notes = [
        _note(start + wait, end + wait, note, hand)
        for start, end, note, hand in played
        if left_out.is_playable(float(start + wait), float(end + wait), note.pitch)
    ]
    if not notes:
        rest = f", only {left_out}" if str(left_out) else ""
        raise ScoreError(f"MusicXML file {str(path)!r} has no notes to play{rest}.")
    last = max(note.offset for note in notes)
    source, timed = parts[0]
    lines = sorted({float(line + wait) for line in timed.measures[int(source.has_pickup) :]})
    pedals = [press for _, timed in parts for press in _presses(timed.pedals, wait)]
    return Score(
        notes=notes,
        pedals=pedals,
        title=path.stem,
        bars=[line for line in lines if line < last],
    )


def _note(start: Fraction, end: Fraction, note: NoteDetails, hand: Hand | None) -> Note:
    known = hand is not None and note.fingers
    finger = finger_of(hand, note.fingers[0]) if hand is not None and known else UNKNOWN_FINGER
    return Note(
        onset=float(start),
        offset=float(end),
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
    fingered = any(note.fingers for note in part.notes.values())
    by_clef: Hand = "left" if part.clefs.get(1) == "F" else "right"
    return [{1: by_name[0] or (by_clef if fingered else None)}]


def _middle(part: SourcePart) -> float:
    return statistics.median(note.pitch for note in part.notes.values())


def _tied_notes(
    source: SourcePart, timed: TimedPart
) -> list[tuple[Fraction, Fraction, NoteDetails]]:
    """Return the notes with those joined that are tied."""
    notes: list[tuple[Fraction, Fraction, NoteDetails]] = []
    open_ties: dict[tuple[int, Fraction], list[int]] = {}
    for note_id, start, end in timed.notes:
        note = source.notes.get(note_id)
        if note is None:
            continue
        if note.is_staccato and not (note.tied_on or note.tied_back):
            end = (start + end) / 2
        candidates = open_ties.get((note.pitch, start), []) if note.tied_back else []
        if candidates:
            same_voice = [i for i in candidates if notes[i][2].voice == note.voice]
            index = (same_voice or candidates)[0]
            candidates.remove(index)
            notes[index] = (notes[index][0], end, notes[index][2])
        else:
            index = len(notes)
            notes.append((start, end, note))
        if note.tied_on:
            open_ties.setdefault((note.pitch, end), []).append(index)
    return notes


def _with_grace_times(
    notes: list[tuple[Fraction, Fraction, NoteDetails]],
) -> Iterator[tuple[Fraction, Fraction, NoteDetails]]:
    """Play the grace notes, which have no time of their own, before the beat."""
    onsets = sorted({start for start, _, note in notes if not note.grace})
    for start, end, note in notes:
        if note.grace and start == end:
            before = bisect.bisect_left(onsets, start) - 1
            room = (start - onsets[before]) / 2 if before >= 0 else note.grace_run * _GRACE
            length = min(_GRACE, room / note.grace_run)
            start = start - note.grace * length
            end = start + length
        yield start, end, note


def _presses(pedals: list[tuple[Fraction, Fraction]], wait: Fraction) -> Iterator[Pedal]:
    """Yield the presses of one part, with the pedal up for a moment between two of them."""
    last_up = None
    for down, up in sorted(pedals):
        if last_up is not None and down <= last_up:
            down = last_up + _LIFT
        if up > down:
            last_up = up
            yield Pedal(onset=float(down + wait), offset=float(up + wait))
