"""The music as a MusicXML document has it: the notes of each part, in quarter notes."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, field
from fractions import Fraction
from xml.etree.ElementTree import Element

from sb3_piano.music.formats.musicxml.document import read_document
from sb3_piano.music.formats.musicxml.notes import (
    SourceNote,
    count_grace_notes,
    mark_closing,
    read_note,
    read_number,
    share_out,
)
from sb3_piano.music.formats.musicxml.timing import Marks
from sb3_piano.music.text_file import read_whole

_QUARTERS = {"whole": 4.0, "half": 2.0, "quarter": 1.0, "eighth": 0.5, "16th": 0.25, "32nd": 0.125}
_LEAPS = ("dacapo", "dalsegno", "segno", "tocoda", "coda", "fine")


@dataclass(eq=False)
class SourcePart:
    """A part of the file; its times are in quarter notes.

    Attributes:
        name: What the file calls it; may be empty.
        notes: The notes that sound, in the order of the file.
        pedals: (down, up) of each press of the pedal.
        measures: When each measure begins that is a whole one, no upbeat.
        staves: How many staves it has.
        clef: The first clef of its first staff, by its letter.
    """

    name: str
    notes: list[SourceNote] = field(default_factory=list)
    pedals: list[tuple[Fraction, Fraction]] = field(default_factory=list)
    measures: list[Fraction] = field(default_factory=list)
    staves: int = 1
    clef: str = ""


def parse_document(content: bytes) -> tuple[list[SourcePart], Marks]:
    """Return the parts in the bytes of a file, and the marks that all of them go by.

    Raises:
        ValueError: If it is too large, no MusicXML, or a number in it is none.
        Exception: Whatever zipfile and ElementTree raise at a damaged file.
    """
    root = read_document(content)
    names = {part.get("id"): part.findtext("part-name") for part in root.iter("score-part")}
    marks, elements = Marks(), root.findall("part")
    readers = [_PartReader(SourcePart(names.get(one.get("id")) or ""), marks) for one in elements]
    end = Fraction(0)
    for measures in itertools.zip_longest(*(one.findall("measure") for one in elements)):
        # A measure is as long as in its longest part: others may leave rests out.
        there = [pair for pair in zip(readers, measures, strict=True) if pair[1] is not None]
        start, end = end, max([reader.read(measure, end) for reader, measure in there])
        if end == start and not any(_is_upbeat(measure) for _, measure in there):
            end += max(reader.meter for reader, _ in there)  # of a rest that nobody has written
        for reader, measure in there:
            reader.close(measure, end)
        marks.end_measure(end)
    for reader in readers:
        reader.release_pedal(end)
        count_grace_notes(reader.part.notes)
        share_out(reader.part.notes)
    return [reader.part for reader in readers], marks


class _PartReader:
    """Walk through the measures of a part."""

    def __init__(self, part: SourcePart, marks: Marks) -> None:
        self.part = part
        self._marks = marks
        self._divisions = Fraction(1)
        self._transposition = 0
        self.meter = Fraction(0)
        """Length of a measure, in quarter notes, once it is known."""
        self._here = Fraction(0)
        self._struck = (Fraction(0), Fraction(0))
        self._pedal_down: Fraction | None = None

    def read(self, measure: Element, start: Fraction) -> Fraction:
        """Read a measure, but for the bar line at its end, and return where its last voice ends."""
        if not _is_upbeat(measure):
            self.part.measures.append(start)
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
        """Read the bar line at the end of a measure that was read, now that all parts have been."""
        for barline in filter(_is_last, measure.findall("barline")):
            self._read_barline(barline, end)

    def release_pedal(self, at: Fraction) -> None:
        """Note that the pedal is up, if it is down."""
        if self._pedal_down is not None:
            self.part.pedals.append((self._pedal_down, at))
        self._pedal_down = None

    def _duration(self, element: Element) -> Fraction:
        duration = read_number(element.findtext("duration") or "0") / self._divisions
        if duration < 0:
            raise ValueError(f"a duration is {element.findtext('duration')}, less than 0")
        return duration

    def _read_note(self, element: Element) -> None:
        if element.find("chord") is None:
            end = self._here + self._duration(element)
            self._struck, self._here = (self._here, end), end
        if element.find("pitch") is not None and element.find("cue") is None:
            note = read_note(element, self._struck, self._transposition)
            self.part.notes.append(note)
            self.part.staves = max(self.part.staves, note.staff)

    def _read_attributes(self, element: Element) -> None:
        self._divisions = read_number(element.findtext("divisions") or "0") or self._divisions
        self.part.staves = max(self.part.staves, int(element.findtext("staves") or 1))
        meter = element.find("time")
        if meter is not None:
            self.meter = _length(meter)
        for clef in element.findall("clef"):
            if clef.get("number", "1") == "1":
                self.part.clef = self.part.clef or clef.findtext("sign") or ""
        transpose = element.find("transpose")
        if transpose is not None:
            chromatic = round(float(transpose.findtext("chromatic") or 0))
            octaves = int(transpose.findtext("octave-change") or 0)
            self._transposition = chromatic + 12 * octaves

    def _read_direction(self, element: Element) -> None:
        for sound in element.findall("sound"):
            self._read_sound(sound)
        tempo = _metronome_tempo(element)
        if tempo is not None:
            self._marks.add_tempo(self._here, tempo, printed=True)
        for pedal in element.findall("direction-type/pedal"):
            kind = pedal.get("type")
            if kind in ("start", "change", "stop"):
                self.release_pedal(self._here)
                self._pedal_down = None if kind == "stop" else self._here

    def _read_sound(self, element: Element) -> None:
        if element.get("tempo") is not None:
            self._marks.add_tempo(self._here, float(element.get("tempo", "")))
        for kind in _LEAPS:
            name = element.get(kind)
            if name is not None and name != "no":
                self._marks.add(self._here, kind, name)

    def _read_barline(self, element: Element, at: Fraction) -> None:
        repeat, ending = element.find("repeat"), element.find("ending")
        if repeat is not None:
            self._marks.add(at, repeat.get("direction", ""), repeat.get("times", ""))
        if ending is not None and ending.get("type") == "start":
            numbers = {int(number) for number in re.findall(r"\d+", ending.get("number", ""))}
            self._marks.begin_ending(at, numbers)
        elif ending is not None:
            self._marks.end_ending(at)


def _is_upbeat(measure: Element) -> bool:
    """Return whether a measure is not a whole one."""
    return measure.get("implicit") == "yes" or measure.get("number") == "0"


def _length(meter: Element) -> Fraction:
    """Return the quarter notes of a meter, which may be a sum such as 3/8 + 2/4; 0 without one."""
    length = Fraction(0)
    for beats, unit in zip(meter.findall("beats"), meter.findall("beat-type"), strict=False):
        count = sum(int(number) for number in re.findall(r"\d{1,3}", beats.text or ""))
        length += Fraction(4 * count, read_whole((unit.text or "").strip()) or 4)
    return length


def _is_last(barline: Element) -> bool:
    """Return whether a bar line is the one at the end of its measure."""
    return barline.get("location", "right") not in ("left", "middle")


def _metronome_tempo(direction: Element) -> float | None:
    """Return the quarter notes per minute of a metronome mark."""
    mark = direction.find("direction-type/metronome")
    if mark is None:
        return None
    number = re.search(r"\d+(\.\d+)?", mark.findtext("per-minute") or "")
    unit = _QUARTERS.get((mark.findtext("beat-unit") or "").strip())
    if number is None or unit is None:
        return None
    dots = len(mark.findall("beat-unit-dot"))
    return float(number[0]) * unit * (2 - 0.5**dots)
