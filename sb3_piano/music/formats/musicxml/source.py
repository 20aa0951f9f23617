"""The music as a MusicXML document has it: the notes of each part, in quarter notes."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from xml.etree.ElementTree import Element

from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.formats.musicxml.document import read_document
from sb3_piano.music.formats.musicxml.timing import Marks
from sb3_piano.music.pitch import SEMITONES
from sb3_piano.music.text_file import read_whole

FORTE = 90
"""The velocity of which MusicXML gives dynamics in per cent."""

_FINGERS = re.compile(r"\s*([1-5])(\s*[-_\u2013/]\s*[1-5])*\s*")
_DOTS = ("staccato", "staccatissimo", "spiccato")
_QUARTERS = {"whole": 4.0, "half": 2.0, "quarter": 1.0, "eighth": 0.5, "16th": 0.25, "32nd": 0.125}
_LEAPS = ("dacapo", "dalsegno", "segno", "tocoda", "coda", "fine")


@dataclass(kw_only=True, eq=False)
class SourceNote:
    """A note as it is written, and after repeats are unfolded as it is played.

    Attributes:
        start: When it begins, in quarter notes; later in s.
        end: When it ends, likewise; a grace note ends where it starts.
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
        closes: Whether it is a grace note after the last note of its voice in a measure.
        is_staccato: Whether it has a dot or a wedge.
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
        _count_grace_notes(reader.part.notes)
        _share_out(reader.part.notes)
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
        _mark_closing(self.part.notes[known:], start)
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
        duration = _number(element.findtext("duration") or "0") / self._divisions
        if duration < 0:
            raise ValueError(f"a duration is {element.findtext('duration')}, less than 0")
        return duration

    def _read_note(self, element: Element) -> None:
        if element.find("chord") is None:
            end = self._here + self._duration(element)
            self._struck, self._here = (self._here, end), end
        if element.find("pitch") is not None and element.find("cue") is None:
            note = _note(element, self._struck, self._transposition)
            self.part.notes.append(note)
            self.part.staves = max(self.part.staves, note.staff)

    def _read_attributes(self, element: Element) -> None:
        self._divisions = _number(element.findtext("divisions") or "0") or self._divisions
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


def _number(text: str) -> Fraction:
    # By way of a float, which has an end: Fraction("1e999999999") would fill the memory.
    return Fraction(str(float(text)))


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


def _note(element: Element, span: tuple[Fraction, Fraction], transposition: int) -> SourceNote:
    """Read a note that has a pitch."""
    step = (element.findtext("pitch/step") or "").strip()
    if step not in SEMITONES:
        raise ValueError(f"a pitch has the step {step!r}")
    height = SEMITONES[step] + float(element.findtext("pitch/alter") or 0)
    octave = int(element.findtext("pitch/octave") or "none")
    ties = {tie.get("type") for tie in (*element.findall("tie"), *element.findall(".//tied"))}
    dynamics = float(element.get("dynamics") or 100 * DEFAULT_VELOCITY / FORTE)
    return SourceNote(
        start=span[0],
        end=span[1],
        pitch=round(12 * (octave + 1) + height) + transposition,
        voice=element.findtext("voice") or "1",
        staff=int(element.findtext("staff") or 1),
        fingers=_fingers(element),
        velocity=min(max(round(dynamics * FORTE / 100), 1), 127),
        tied_back="stop" in ties,
        tied_on="start" in ties,
        in_chord=element.find("chord") is not None,
        grace=int(element.find("grace") is not None),
        is_staccato=any(element.find(f"notations/articulations/{d}") is not None for d in _DOTS),
    )


def _fingers(note: Element) -> tuple[int, ...]:
    """Return the fingers that play the onset: no substitutes, no alternatives."""
    texts = [
        fingering.text or ""
        for fingering in note.findall("notations/technical/fingering")
        if fingering.get("substitution") != "yes" and fingering.get("alternate") != "yes"
    ]
    return tuple(int(match[1]) for match in map(_FINGERS.fullmatch, texts) if match)


def _mark_closing(measure: Sequence[SourceNote], start: Fraction) -> None:
    """Mark the grace notes after the last note of each voice in a measure, by when it begins."""
    ended = set()
    for note in reversed(measure):
        if not note.grace or note.start == start:
            ended.add(note.voice)
        note.closes = note.voice not in ended


def _count_grace_notes(notes: list[SourceNote]) -> None:
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


def _share_out(notes: list[SourceNote]) -> None:
    """Give the fingers and the dot of a chord that stand at one of its notes to all of them.

    Fingers and keys go the same way: in the right hand the higher finger has the higher key, in
    the left hand the lower key; the left hand is on the second staff.
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
