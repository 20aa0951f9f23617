"""What partitura's document of a score lacks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from sb3_piano.music.constants import DEFAULT_VELOCITY
from sb3_piano.music.formats.musicxml.document import HIDDEN_REST
from sb3_piano.music.formats.musicxml.measures import Grid, Measure
from sb3_piano.music.formats.musicxml.notes import FORTE
from sb3_piano.music.score import Score

_DOCTYPE = (
    '<!DOCTYPE score-partwise PUBLIC "-//Recordare//DTD MusicXML 3.1 Partwise//EN" '
    '"http://www.musicxml.org/dtds/partwise.dtd">'
)


def finished(document: bytes, score: Score, grid: Grid, measures: Sequence[Measure]) -> bytes:
    """Return partitura's document with title, tempo, velocities and presses of the pedal."""
    from lxml import etree

    root = etree.fromstring(document)
    work = etree.Element("work")
    etree.SubElement(work, "work-title").text = _xml_text(score.title)
    root.insert(0, work)
    for element in root.iter("note"):
        _finish_note(element, score)
    pedals = _pedal_marks(score, grid, measures)
    elements = root.findall("part/measure")
    for element, measure in zip(elements, measures, strict=True):
        if measure.is_pickup:
            element.set("implicit", "yes")
        _add_pedal_marks(element, measure, pedals[measure.start])
    after = elements[0].find("attributes")
    after.addnext(_tempo_mark(grid.tempo))
    return etree.tostring(
        root, encoding="UTF-8", xml_declaration=True, pretty_print=True, doctype=_DOCTYPE
    )


def _finish_note(element: Any, score: Score) -> None:
    if element.find("rest") is not None:
        if element.attrib.pop("id").startswith(HIDDEN_REST):
            element.set("print-object", "no")
        return
    velocity = score.notes[int(element.get("id")[1:].split("-")[0])].velocity
    if velocity != DEFAULT_VELOCITY:
        element.set("dynamics", f"{100 * velocity / FORTE:.2f}")


def _xml_text(text: str) -> str:
    """Return a text without the characters that XML cannot hold."""
    return "".join(char for char in text if char.isprintable())


def _tempo_mark(tempo: Fraction) -> Any:
    from lxml import etree

    mark = etree.Element("direction", placement="above")
    metronome = etree.SubElement(etree.SubElement(mark, "direction-type"), "metronome")
    etree.SubElement(metronome, "beat-unit").text = "quarter"
    etree.SubElement(metronome, "per-minute").text = f"{float(tempo):g}"
    etree.SubElement(mark, "sound", tempo=_decimal(tempo))
    return mark


def _decimal(number: Fraction) -> str:
    return str(int(number)) if number.denominator == 1 else repr(float(number))


def _pedal_marks(
    score: Score, grid: Grid, measures: Sequence[Measure]
) -> dict[int, list[tuple[int, str]]]:
    """Return the marks of each measure, by its start: (tick, start or stop)."""
    marks: list[tuple[int, str]] = []
    for pedal in score.pedals:
        down, up = grid.span(pedal)
        if marks and down <= marks[-1][0]:
            marks.pop()  # too little time for a tick between them
        else:
            marks.append((down, "start"))
        marks.append((up, "stop"))
    by_measure = defaultdict(list)
    for tick, kind in marks:
        # What ends with a measure is written in it.
        place = tick - int(kind == "stop")
        measure = next(m for m in reversed(measures) if m.start <= place)
        by_measure[measure.start].append((tick, kind))
    return by_measure


def _add_pedal_marks(element: Any, measure: Measure, marks: Sequence[tuple[int, str]]) -> None:
    """Add the marks behind the notes, and go to the end of the measure."""
    from lxml import etree

    here = measure.start + _length(element)
    for tick, kind in [*marks, (measure.end, "")]:
        if tick != here:
            move = etree.SubElement(element, "forward" if tick > here else "backup")
            etree.SubElement(move, "duration").text = str(abs(tick - here))
        here = tick
        if kind:
            mark = etree.SubElement(element, "direction", placement="below")
            etree.SubElement(etree.SubElement(mark, "direction-type"), "pedal", type=kind)
            etree.SubElement(mark, "staff").text = "2"


def _length(element: Any) -> int:
    """Return how far the contents of a measure lead from its start."""
    length = 0
    for child in element:
        if child.tag in ("note", "forward", "backup") and child.find("chord") is None:
            length += int(child.findtext("duration")) * (-1 if child.tag == "backup" else 1)
    return length
