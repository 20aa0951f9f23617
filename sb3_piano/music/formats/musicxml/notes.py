"""Notes of a MusicXML document as written, and the marks that chords share."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from xml.etree.ElementTree import Element

from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.pitch import SEMITONES
from sb3_piano.music.text_file import read_whole

FORTE = 90
"""The velocity of 100 per cent in MusicXML's dynamics."""

_FINGERS = re.compile(r"\s*([1-5])(\s*[-_\u2013/]\s*[1-5])*\s*")
_KINDS = (
    *("maxima", "long", "breve", "whole", "half", "quarter", "eighth"),
    *("16th", "32nd", "64th", "128th", "256th", "512th", "1024th"),
)
_VALUES = {kind: Fraction(32, 2**halvings) for halvings, kind in enumerate(_KINDS)}
_TUPLET = ("actual", "normal")
_MOST_DOTS = 4
_DOTS = ("staccato", "staccatissimo", "spiccato")


@dataclass(kw_only=True, eq=False)
class SourceNote:
    """A note as written; after repeats are unfolded, as played.

    Attributes:
        start: Its start, in quarter notes; later in s.
        end: Its end, likewise; a grace note ends where it starts.
        pitch: Sounding MIDI pitch, after transposition; microtones are rounded.
        voice: The voice, as the file names it.
        staff: The staff, from 1.
        fingers: Pianists' numbers, 1 to 5; several if the file writes the fingers of a whole chord
            at one of its notes.
        velocity: 1-127.
        tied_back: Whether a tie ends here.
        tied_on: Whether a tie begins here.
        in_chord: Whether it is struck with the note before it in the file.
        grace: For a grace note, the number of grace notes from it to the beat, from 1; else 0.
        grace_run: Number of grace notes (or chords) in its run.
        closes: Whether it is a grace note after the last note of its voice in a measure.
        is_staccato: Whether it has a dot or a wedge.
        measure: Index of the measure in the file.
        in_tuplet: Whether it belongs to a tuplet, such as a triplet.
        doubling: Interval of a second note that sounds with it, in semitones; 0 without one.
    """

    start: Fraction
    end: Fraction
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
    closes: bool = False
    is_staccato: bool
    measure: int = 0
    in_tuplet: bool
    doubling: int = 0


@lru_cache(maxsize=1024)
def read_number(text: str | None) -> Fraction:
    """Parse a number, which may have a decimal comma; 0 for empty text."""
    # Floats are bounded, but Fraction("1e999999999") would fill the memory.
    return Fraction(str(float((text or "").strip().replace(",", ".") or 0)))


def note_value(kind: str | None, dots: int = 0, tuplet: Element | None = None) -> Fraction:
    """Return the length of a kind of note in quarter notes, 0 for an unknown kind."""
    value = _VALUES.get((kind or "").strip().lower(), Fraction(0))
    value *= 2 - Fraction(1, 2 ** min(dots, _MOST_DOTS))
    if tuplet is not None:
        actual, normal = (read_whole(tuplet.findtext(f"{one}-notes") or "") or 1 for one in _TUPLET)
        value *= Fraction(normal, actual)
    return value


def read_note(element: Element, span: tuple[Fraction, Fraction]) -> SourceNote:
    """Read a note with a pitch."""
    step = (element.findtext("pitch/step") or "").strip()
    if step not in SEMITONES:
        raise ValueError(f"a pitch has the step {step!r}")
    height = SEMITONES[step] + read_number(element.findtext("pitch/alter"))
    octave = int(element.findtext("pitch/octave") or "none")
    ties = {tie.get("type") for tie in (*element.findall("tie"), *element.findall(".//tied"))}
    if "continue" in ties:
        ties |= {"start", "stop"}
    dynamics = element.get("dynamics")
    velocity = read_number(dynamics) * FORTE / 100 if dynamics else DEFAULT_VELOCITY
    return SourceNote(
        start=span[0],
        end=span[1],
        pitch=round(12 * (octave + 1) + height),
        voice=element.findtext("voice") or "1",
        staff=int(element.findtext("staff") or 1),
        fingers=_fingers(element),
        velocity=min(max(round(velocity), 1), 127),
        tied_back="stop" in ties,
        tied_on="start" in ties,
        in_chord=element.find("chord") is not None,
        grace=int(element.find("grace") is not None),
        in_tuplet=element.find("time-modification") is not None,
        is_staccato=any(element.find(f"notations/articulations/{d}") is not None for d in _DOTS),
    )


def _fingers(note: Element) -> tuple[int, ...]:
    """Return the fingers of the onset, without substitutes and alternatives."""
    texts = [
        fingering.text or ""
        for fingering in note.findall("notations/technical/fingering")
        if fingering.get("substitution") != "yes" and fingering.get("alternate") != "yes"
    ]
    return tuple(int(match[1]) for match in map(_FINGERS.fullmatch, texts) if match)


def mark_closing(measure: Sequence[SourceNote], start: Fraction) -> None:
    """Mark the grace notes after the last note of each voice in a measure."""
    ended = set()
    for note in reversed(measure):
        if not note.grace or note.start == start:
            ended.add(note.voice)
        note.closes = note.voice not in ended


def count_grace_notes(notes: list[SourceNote]) -> None:
    """Number the grace notes of each run backwards from the beat."""
    run: list[SourceNote] = []
    for note in [*notes, None]:
        place = None if note is None else (note.voice, note.start)
        if note is not None and note.grace and (not run or place == (run[-1].voice, run[-1].start)):
            run.append(note)
            continue
        left = total = sum(not one.in_chord for one in run) or 1
        for position, one in enumerate(run):
            left -= int(position > 0 and not one.in_chord)
            one.grace, one.grace_run = max(left, 1), total
        run = [note] if note is not None and note.grace else []


def share_out(notes: list[SourceNote]) -> None:
    """Distribute the fingers and the dot of a chord from one note to all its notes.

    In the right hand the higher finger gets the higher key, in the left hand the lower key. The
    left hand is on the second staff.
    """
    chords: list[list[SourceNote]] = []
    for note in notes:
        if not note.in_chord or not chords or note.start != chords[-1][0].start:
            chords.append([])
        chords[-1].append(note)
    for chord in chords:
        dotted = any(note.is_staccato for note in chord)
        for note in chord:
            note.is_staccato = dotted
        numbers = sorted(finger for note in chord for finger in note.fingers)
        if len(numbers) == len(chord) and any(len(note.fingers) > 1 for note in chord):
            sign = -1 if chord[0].staff == 2 else 1
            chord.sort(key=lambda note: sign * note.pitch)
            for note, number in zip(chord, numbers, strict=True):
                note.fingers = (number,)
