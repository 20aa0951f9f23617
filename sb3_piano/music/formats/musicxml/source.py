"""What is taken from a MusicXML file directly, and what of it partitura gets to read.

partitura places the notes in time and unfolds repeats. It reads one fingering a note, written
pitches, no microtones, no change of the pedal, and no tempo without a ``sound`` element; it also
stops at notation that does not concern us, such as a tuplet that ends before it begins. So the
details of each note are taken from the file here, under an id by which the note is found again,
and partitura gets a document of what it is needed for: lengths, tempos, pedals and repeats.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from sb3_piano.music.formats.musicxml.container import xml_parser
from sb3_piano.music.formats.musicxml.notes import NoteDetails, complete, details_of
from sb3_piano.music.formats.musicxml.skeleton import strip_part


@dataclass
class SourcePart:
    """A part of the file.

    Attributes:
        name: What the file calls it; may be empty.
        notes: The notes that sound, by the id that partitura sees, in the order of the file.
        staves: How many staves it has.
        clefs: The first clef of each staff, by its letter.
        has_pickup: Whether the first measure is not a whole one.
    """

    name: str
    notes: dict[str, NoteDetails] = field(default_factory=dict)
    staves: int = 1
    clefs: dict[int, str] = field(default_factory=dict)
    has_pickup: bool = False


def parse_source(document: bytes) -> tuple[list[SourcePart], bytes]:
    """Return the parts of a document, and the document that partitura is to read.

    Raises:
        ValueError: If it is no partwise MusicXML.
        Exception: Whatever lxml raises at damaged XML.
    """
    from lxml import etree

    root = etree.fromstring(document, xml_parser())
    if root.tag != "score-partwise":
        raise ValueError(f"its root is <{root.tag}>, not <score-partwise>")
    names = {part.get("id"): part.findtext("part-name") for part in root.iter("score-part")}
    elements = root.findall("part")
    parts = []
    for index, element in enumerate(elements):
        part = SourcePart(name=names.get(element.get("id")) or "")
        _read_part(element, part, f"p{index}")
        strip_part(element)
        element.set("id", f"p{index}")
        parts.append(part)
    skeleton = etree.Element("score-partwise")
    part_list = etree.SubElement(skeleton, "part-list")
    for element in elements:
        etree.SubElement(part_list, "score-part", id=element.get("id"))
    skeleton.extend(elements)
    return parts, etree.tostring(skeleton)


def _read_part(element: Any, part: SourcePart, prefix: str) -> None:
    transposition = 0
    for index, measure in enumerate(element.findall("measure")):
        if index == 0:
            part.has_pickup = measure.get("implicit") == "yes" or measure.get("number") == "0"
        for child in measure:
            if child.tag == "attributes":
                transposition = _read_attributes(child, part, transposition)
            elif child.tag == "note":
                child.attrib.pop("id", None)
                if child.find("pitch") is not None and child.find("cue") is None:
                    note_id = f"{prefix}n{len(part.notes)}"
                    child.set("id", note_id)
                    part.notes[note_id] = details_of(child, transposition)
    part.staves = max([part.staves, *(note.staff for note in part.notes.values())])
    complete(part.notes)


def _read_attributes(element: Any, part: SourcePart, transposition: int) -> int:
    part.staves = max(part.staves, int(element.findtext("staves") or 1))
    for clef in element.findall("clef"):
        part.clefs.setdefault(int(clef.get("number") or 1), clef.findtext("sign") or "")
    transpose = element.find("transpose")
    if transpose is None:
        return transposition
    chromatic = round(float(transpose.findtext("chromatic") or 0))
    return chromatic + 12 * int(transpose.findtext("octave-change") or 0)
