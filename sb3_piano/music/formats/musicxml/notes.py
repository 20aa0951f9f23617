"""What a MusicXML file says about each note, apart from its place in time."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from sb3_piano.music.constants import DEFAULT_VELOCITY

FORTE = 90
"""The velocity of which MusicXML gives dynamics in per cent."""

_STEPS = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}

_FINGERS = re.compile(r"\s*([1-5])(\s*[-_\u2013/]\s*[1-5])*\s*")


@dataclass(frozen=True, kw_only=True)
class NoteDetails:
    """What a ``note`` element says, apart from its place in time.

    Attributes:
        pitch: MIDI pitch as it sounds, that is after transposition; microtones are rounded.
        voice: The voice, as the file names it.
        staff: The staff, from 1.
        fingers: Pianists' numbers, 1 to 5. More than one if the file gives those of a whole chord
            at one of its notes.
        velocity: 1-127.
        tied_back: Whether a tie ends here.
        tied_on: Whether a tie begins here.
        in_chord: Whether it is struck with the note before it in the file.
        grace: If it is a grace note: how many are still to come before the beat, from 1; else 0.
        grace_run: Of how many grace notes (or chords) the run consists that it is one of.
        is_staccato: Whether it has a dot or a wedge.
    """

    pitch: int
    voice: str
    staff: int
    fingers: tuple[int, ...]
    velocity: int
    tied_back: bool
    tied_on: bool
    in_chord: bool
    grace: int
    grace_run: int = 0
    is_staccato: bool


def details_of(note: Any, transposition: int) -> NoteDetails:
    """Read a ``note`` element that has a pitch.

    Args:
        note: The element.
        transposition: Semitones by which its part sounds higher than it is written.
    """
    pitch = note.find("pitch")
    height = _STEPS[pitch.findtext("step").strip()] + float(pitch.findtext("alter") or 0)
    octave = int(pitch.findtext("octave"))
    ties = {tie.get("type") for tie in (*note.findall("tie"), *note.findall("notations/tied"))}
    dynamics = float(note.get("dynamics") or 100 * DEFAULT_VELOCITY / FORTE)
    dots = ("staccato", "staccatissimo", "spiccato")
    return NoteDetails(
        pitch=round(12 * (octave + 1) + height) + transposition,
        voice=note.findtext("voice") or "1",
        staff=int(note.findtext("staff") or 1),
        fingers=_fingers(note),
        velocity=min(max(round(dynamics * FORTE / 100), 1), 127),
        tied_back="stop" in ties,
        tied_on="start" in ties,
        in_chord=note.find("chord") is not None,
        grace=int(note.find("grace") is not None),
        is_staccato=any(note.find(f"notations/articulations/{dot}") is not None for dot in dots),
    )


def complete(notes: dict[str, NoteDetails]) -> None:
    """Put in, in place, what notes know only from their neighbours.

    Args:
        notes: The notes of a part in the order of the file, by their ids.
    """
    _count_grace_notes(notes)
    _share_out_fingers(notes)


def _fingers(note: Any) -> tuple[int, ...]:
    """Return the fingers that play the onset: no substitutes, no alternatives."""
    texts = [
        fingering.text or ""
        for fingering in note.findall("notations/technical/fingering")
        if fingering.get("substitution") != "yes" and fingering.get("alternate") != "yes"
    ]
    return tuple(int(match[1]) for match in map(_FINGERS.fullmatch, texts) if match)


def _count_grace_notes(notes: dict[str, NoteDetails]) -> None:
    """Number the grace notes of each run backwards from the beat."""
    run: list[str] = []
    for note_id, note in [*notes.items(), ("", None)]:
        if note is not None and note.grace and (not run or notes[run[-1]].voice == note.voice):
            run.append(note_id)
            continue
        left = sum(not notes[one].in_chord for one in run) or 1
        total = left
        for position, one in enumerate(run):
            left -= int(position > 0 and not notes[one].in_chord)
            notes[one] = replace(notes[one], grace=max(left, 1), grace_run=total)
        run = [note_id] if note is not None and note.grace else []


def _share_out_fingers(notes: dict[str, NoteDetails]) -> None:
    """Give the fingers of a chord that stand at one of its notes to all of them.

    Fingers and keys go the same way: in the right hand the higher finger has the higher key, in
    the left hand the lower key; the left hand is on the second staff.
    """
    for chord in _chords(notes):
        numbers = sorted(finger for one in chord for finger in notes[one].fingers)
        stacked = any(len(notes[one].fingers) > 1 for one in chord)
        if stacked and len(numbers) == len(chord):
            sign = -1 if notes[chord[0]].staff == 2 else 1
            chord.sort(key=lambda one: sign * notes[one].pitch)
            for one, number in zip(chord, numbers, strict=True):
                notes[one] = replace(notes[one], fingers=(number,))


def _chords(notes: dict[str, NoteDetails]) -> Iterator[list[str]]:
    chord: list[str] = []
    for note_id, note in list(notes.items()):
        if not note.in_chord and chord:
            yield chord
            chord = []
        chord.append(note_id)
    if chord:
        yield chord
