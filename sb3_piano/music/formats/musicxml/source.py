"""Read the notes of each part of a MusicXML document, in quarter notes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from xml.etree.ElementTree import Element

from sb3_piano.music.formats.musicxml.document import read_document
from sb3_piano.music.formats.musicxml.notes import (
    SourceNote,
    count_grace_notes,
    mark_closing,
    note_value,
    read_note,
    read_number,
    share_out,
)
from sb3_piano.music.formats.musicxml.tempo_marks import metronome_tempo
from sb3_piano.music.formats.musicxml.timing import Marks
from sb3_piano.music.text_file import read_whole

_DIVISIONS = "measure/attributes/divisions"
_DAMPER = "damper-pedal"
_HALF_DOWN = 50
"""Least per cent of a damper pedal that is down."""

NAMELESS = re.compile(r"(musicxml )?(part|instrument|track|staff|stave|p)?[\s_.#-]*\d*", re.I)
"""Names of parts without information."""

_NO_KEY = 999
"""Limit of the pitch of damaged files' notes, up and down, as their names would be endless."""


@dataclass(eq=False)
class SourcePart:
    """A part of the file; its times are in quarter notes.

    Attributes:
        name: Its name in the file; may be empty.
        is_keyboard: Whether the file gives it the sound of a keyboard instrument.
        notes: Sounding notes, in the order of the file.
        pedals: (down, up) of each press of the pedal.
        measures: Start of each whole measure, without upbeats.
        staves: Number of staves.
        clef: The first clef of its first staff, by its letter.
    """

    name: str
    is_keyboard: bool
    notes: list[SourceNote] = field(default_factory=list)
    pedals: list[tuple[Fraction, Fraction]] = field(default_factory=list)
    measures: list[Fraction] = field(default_factory=list)
    staves: int = 1
    clef: str = ""


def parse_document(content: bytes) -> tuple[list[SourcePart], Marks]:
    """Parse the bytes of a file; return its parts and their common marks.

    Raises:
        ValueError: If it is too large, is not MusicXML, or has a malformed number.
        Exception: Any error of zipfile and ElementTree for a damaged file.
    """
    root = read_document(content)
    names = _part_names(root)
    marks, elements = Marks(), root.findall("part")
    readers = [
        _PartReader(SourcePart(*names.get(one.get("id", ""), ("", False))), marks, divisions)
        for one, divisions in zip(elements, _first_divisions(elements), strict=True)
    ]
    end = Fraction(0)
    for measures in itertools.zip_longest(*(one.findall("measure") for one in elements)):
        # A measure is as long as in its longest part; others may omit rests.
        there = [pair for pair in zip(readers, measures, strict=True) if pair[1] is not None]
        start, end = end, max([reader.read(measure, end) for reader, measure in there])
        upbeat = any(_is_upbeat(measure) for _, measure in there)
        if end == start and not upbeat:
            end += max(reader.meter for reader, _ in there)  # an unwritten rest
        for reader, measure in there:
            reader.close(measure, end)
        marks.signs.end_measure(there[0][1].get("number", ""), start, end)
        marks.swings.bars.append((start, end if upbeat else start))
    for reader in readers:
        reader.finish(end)
    marks.signs.finish()
    return [reader.part for reader in readers], marks


def _part_names(root: Element) -> dict[str, tuple[str, bool]]:
    """Map each part's id to its name, and to whether it sounds as a keyboard.

    A piano program counts only for a nameless part, since it is the default.
    """
    found = {}
    for part in root.iter("score-part"):
        tags = ("part-name", "score-instrument/instrument-name", "part-abbreviation")
        names = [(part.findtext(tag) or "").strip() for tag in tags]
        name = next(filter(None, names), "")
        sounds = [each.text or "" for each in part.iterfind("score-instrument/instrument-sound")]
        programs = [each.text or "" for each in part.iterfind("midi-instrument/midi-program")]
        is_piano = bool(NAMELESS.fullmatch(name)) and any(
            text.strip() in map(str, range(1, 9)) for text in programs
        )
        is_keyboard = any(sound.strip().startswith("keyboard") for sound in sounds)
        found[part.get("id", "")] = name, is_keyboard or is_piano
    return found


def _first_divisions(parts: Sequence[Element]) -> list[list[Fraction]]:
    """Find the first divisions of each part, anywhere in it.

    Each is a list of one item; a part without divisions shares another part's list.
    """
    found = [
        filter(None, (read_number(element.text) for element in part.iterfind(_DIVISIONS)))
        for part in parts
    ]
    own = [list(itertools.islice(divisions, 1)) for divisions in found]
    others = next(filter(None, own), [Fraction(1)])
    return [divisions or others for divisions in own]


class _PartReader:
    """Reads the measures of a part; ``divisions`` of a quarter note are its first."""

    def __init__(self, part: SourcePart, marks: Marks, divisions: list[Fraction]) -> None:
        self.part = part
        self._marks = marks
        self._divisions = divisions
        self._transpositions: dict[int, tuple[int, int]] = {}
        """Semitones, and a second note's semitones, by staff; 0 is for every other staff."""
        self.meter = Fraction(0)
        """Length of a measure, in quarter notes; 0 while unknown."""
        self._here = Fraction(0)
        self._struck = (Fraction(0), Fraction(0))
        self._measure = 0
        self._pedal_signs: list[tuple[Fraction, str]] = []

    def read(self, measure: Element, start: Fraction) -> Fraction:
        """Read a measure without its last bar line; return the end of its longest voice."""
        if not _is_upbeat(measure):
            self.part.measures.append(start)
        self._measure += 1
        self._here = end = start
        self._struck = (start, start)
        known = len(self.part.notes)
        for child in measure:
            if child.tag == "note":
                self._read_note(child)
            elif child.tag == "backup":
                self._here = max(self._here - self._duration(child), start)
            elif child.tag == "forward":
                self._here += self._duration(child)
            elif child.tag == "attributes":
                self._read_attributes(child)
            elif child.tag == "direction":
                self._read_direction(child)
            elif child.tag == "sound":
                self._read_sound(child)
            elif child.tag == "barline" and not _is_last(child):
                self._read_barline(child, start if child.get("location") == "left" else self._here)
            end = max(end, self._here)
        mark_closing(self.part.notes[known:], start)
        return end

    def close(self, measure: Element, end: Fraction) -> None:
        """Read the last bar line of a measure, after all parts have read the measure."""
        for barline in filter(_is_last, measure.findall("barline")):
            self._read_barline(barline, end)

    def finish(self, end: Fraction) -> None:
        """Complete the part after its last measure."""
        notes = self.part.notes
        count_grace_notes(notes)
        share_out(notes)
        notes += [
            replace(note, pitch=note.pitch + note.doubling, fingers=())
            for note in notes
            if note.doubling
        ]
        played = self._marks.swings.played
        for note in notes:
            if not note.in_tuplet:
                note.start, note.end = played(note.start), played(note.end)
        down: Fraction | None = None
        # The end of a press may be written after the start of the next.
        for at, kind in sorted(self._pedal_signs, key=lambda sign: (sign[0], sign[1] != "stop")):
            if down is not None and kind != "hold":
                self.part.pedals.append((down, played(at)))
                down = None
            if down is None and kind != "stop":
                down = played(at)
        if down is not None:
            self.part.pedals.append((down, end))

    def _duration(self, element: Element) -> Fraction:
        duration = read_number(element.findtext("duration")) / self._divisions[0]
        if duration < 0:
            raise ValueError(f"a duration is {element.findtext('duration')}, less than 0")
        return duration

    def _read_note(self, element: Element) -> None:
        duration, rest = self._duration(element), element.find("rest")
        dots = len(element.findall("dot"))
        written = note_value(element.findtext("type"), dots, element.find("time-modification"))
        if duration == 0 and element.find("grace") is None:
            is_whole = rest is not None and rest.get("measure") == "yes"
            duration = self.meter if is_whole and self.meter else written
        span = self._struck
        if element.find("chord") is None:
            span = self._struck = (self._here, self._here + duration)
            self._here += duration
        elif duration and written in (0, duration):
            # Programs also write too short durations in chords; the type is then right.
            span = (span[0], span[0] + duration)
        if element.find("pitch") is not None and element.find("cue") is None:
            note = read_note(element, span)
            note.measure = self._measure
            every = self._transpositions.get(0, (0, 0))
            semitones, note.doubling = self._transpositions.get(note.staff, every)
            note.pitch = min(max(note.pitch + semitones, -_NO_KEY), _NO_KEY)
            self.part.notes.append(note)
            self.part.staves = max(self.part.staves, note.staff)

    def _read_attributes(self, element: Element) -> None:
        self._divisions[0] = read_number(element.findtext("divisions")) or self._divisions[0]
        self.part.staves = max(self.part.staves, int(element.findtext("staves") or 1))
        meter = element.find("time")
        if meter is not None:
            self.meter = _length(meter)
        for clef in element.findall("clef"):
            if clef.get("number", "1") == "1":
                self.part.clef = self.part.clef or clef.findtext("sign") or ""
        for transpose in element.findall("transpose"):
            self._read_transpose(transpose)

    def _read_transpose(self, element: Element) -> None:
        octaves = read_number(element.findtext("octave-change"))
        semitones = round(read_number(element.findtext("chromatic")) + 12 * octaves)
        double, staff = element.find("double"), read_whole(element.get("number", "")) or 0
        above = double is not None and double.get("above") == "yes"
        doubling = 0 if double is None else 12 if above else -12
        if not staff:
            self._transpositions.clear()
        self._transpositions[staff] = semitones, doubling

    def _read_direction(self, element: Element) -> None:
        offset = element.find("offset")
        is_heard = offset is not None and offset.get("sound") == "yes"
        at = self._moved(offset if is_heard else None)
        sounds = element.findall("sound")
        self._marks.signs.add_printed(self._here, element)
        for sound in sounds:
            self._read_sound(sound, at)
        for mark in element.findall("direction-type/metronome"):
            tempo = metronome_tempo(mark)
            if tempo is not None and not any(sound.get("tempo") for sound in sounds):
                self._marks.add_tempo(at, tempo[0], printed=True, relative=tempo[1])
        for pedal in element.findall("direction-type/pedal"):
            kind = pedal.get("type", "")
            is_said = kind != "change" and any(sound.get(_DAMPER) for sound in sounds)
            if kind in ("start", "change", "stop") and not is_said:
                self._pedal_signs.append((at, kind))

    def _moved(self, offset: Element | None, at: Fraction | None = None) -> Fraction:
        """Return the sounding place of an element, moved by its offset if it has one."""
        if offset is None:
            return self._here if at is None else at
        return max(self._here + read_number(offset.text) / self._divisions[0], Fraction(0))

    def _read_sound(self, element: Element, at: Fraction | None = None) -> None:
        at = self._moved(element.find("offset"), at)
        if element.get("tempo"):
            self._marks.add_tempo(at, read_number(element.get("tempo")))
        damper, swing = element.get(_DAMPER), element.find("swing")
        if damper:
            is_down = damper == "yes" or (damper != "no" and read_number(damper) >= _HALF_DOWN)
            self._pedal_signs.append((at, "hold" if is_down else "stop"))
        if swing is not None:
            self._marks.swings.add(at, swing)
        self._marks.signs.add_sound(self._here, element)

    def _read_barline(self, element: Element, at: Fraction) -> None:
        signs, repeat, ending = self._marks.signs, element.find("repeat"), element.find("ending")
        signs.add_sound(at, element)
        signs.add_printed(at, element)
        if repeat is not None:
            signs.add_repeat(at, repeat.get("direction", ""), repeat.get("times", ""))
        if ending is not None and ending.get("type") == "start":
            signs.begin_ending(at, ending.get("number") or ending.text or "")
        elif ending is not None:
            signs.end_ending(at)


def _is_upbeat(measure: Element) -> bool:
    """Return whether a measure is incomplete."""
    return measure.get("implicit") == "yes" or measure.get("number") == "0"


def _length(meter: Element) -> Fraction:
    """Return the quarter notes of a meter, also of a sum such as 3/8 + 2/4; 0 without one."""
    length = Fraction(0)
    for beats, unit in zip(meter.findall("beats"), meter.findall("beat-type"), strict=False):
        count = sum(int(number) for number in re.findall(r"\d{1,3}", beats.text or ""))
        length += Fraction(4 * count, read_whole((unit.text or "").strip()) or 4)
    return length


def _is_last(barline: Element) -> bool:
    """Return whether a bar line is the one at the end of its measure."""
    return barline.get("location", "right") not in ("left", "middle")
