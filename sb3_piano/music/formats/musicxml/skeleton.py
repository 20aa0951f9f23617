"""A MusicXML document reduced to what partitura is needed for."""

from __future__ import annotations

import re
from typing import Any

_QUARTERS = {"whole": 4.0, "half": 2.0, "quarter": 1.0, "eighth": 0.5, "16th": 0.25, "32nd": 0.125}

_KEPT = {
    "note": {"chord", "duration"},
    "attributes": {"divisions", "time"},
    "barline": {"repeat", "ending"},
    "direction": {"direction-type", "sound", "staff"},
}
"""Of these elements, the children that partitura needs."""

_KEPT_WHOLE = {"backup", "forward", "sound"}


def strip_part(part: Any) -> None:
    """Leave, in place, the lengths, tempos, pedals and repeats of a ``part`` element.

    Raises:
        ValueError: If a length is no whole number of divisions.
    """
    for measure in part.findall("measure"):
        for element in list(measure):
            if element.tag == "direction":
                _strip_direction(element)
            kept = _KEPT.get(element.tag)
            if kept is None and element.tag not in _KEPT_WHOLE:
                measure.remove(element)
                continue
            for child in list(element):
                if kept is not None and child.tag not in kept:
                    element.remove(child)
            _check_duration(element)
            if element.tag == "note":
                _add_any_pitch(element)


def _add_any_pitch(note: Any) -> None:
    """Make a note, rest or drum what partitura cannot stumble over; its id tells what it is."""
    from lxml import etree

    pitch = etree.SubElement(note, "pitch")
    etree.SubElement(pitch, "step").text = "C"
    etree.SubElement(pitch, "octave").text = "4"


def _strip_direction(direction: Any) -> None:
    """Leave the pedal and the tempo."""
    from lxml import etree

    tempo = _metronome_tempo(direction)
    if tempo is not None and direction.find("sound[@tempo]") is None:
        etree.SubElement(direction, "sound", tempo=repr(tempo))
    for kind in direction.findall("direction-type"):
        pedal = kind.find("pedal")
        if pedal is None:
            direction.remove(kind)
        elif pedal.get("type") == "change":
            # partitura ends the press that is under way when another starts.
            pedal.set("type", "start")


def _metronome_tempo(direction: Any) -> float | None:
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


def _check_duration(element: Any) -> None:
    duration = element.find("duration")
    if duration is None:
        return
    if float(duration.text) % 1:
        raise ValueError(f"a duration is {duration.text} divisions, no whole number")
    duration.text = str(int(float(duration.text)))
