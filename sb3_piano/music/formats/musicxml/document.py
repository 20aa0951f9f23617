"""The document that partitura makes of a score."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.musicxml.measures import DIVISIONS, Grid, Measure
from sb3_piano.music.formats.musicxml.voices import gaps_of, pieces_of, staff_of, voices_of
from sb3_piano.music.hands import finger_number
from sb3_piano.music.note import Note
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.score import Score

REST, HIDDEN_REST = "rest", "hidden"
"""Ids of the rests of the first voice of a staff and of its other voices."""


def partitura_document(score: Score, grid: Grid, measures: Sequence[Measure]) -> bytes:
    """Return the notes, rests, fingers and measures of a score as MusicXML.

    The id of an element of the note with the index 3 is ``n3-0``, or ``n3-1`` if it is the second
    of those that are tied.
    """
    import partitura
    from partitura import score as ps

    part = ps.Part("P1", "Piano", quarter_duration=DIVISIONS)
    part.add(ps.Clef(1, "G", 2, 0), 0)
    part.add(ps.Clef(2, "F", 4, 0), 0)
    meter = None
    for number, measure in enumerate(measures, start=int(not measures[0].is_pickup)):
        part.add(ps.Measure(number=number, name=str(number)), measure.start, measure.end)
        if measure.meter != meter:
            part.add(ps.TimeSignature(*measure.meter), measure.start)
            meter = measure.meter
    lines = [measure.start for measure in measures]
    lowest, voices = voices_of(score, grid)
    taken: dict[int, list[tuple[int, int]]] = {voice: [] for voice in lowest}
    for index, (note, voice) in enumerate(zip(score.notes, voices, strict=True)):
        pieces = pieces_of(*grid.span(note), lines)
        _add_note(part, note, f"n{index}", voice, pieces)
        taken.setdefault(voice, []).extend(pieces)
    for voice, spans in taken.items():
        staff = 1 if voice < lowest[1] else 2
        for start, end in gaps_of(spans, measures, to_the_end=voice in lowest):
            rest = ps.Rest(id=REST if voice in lowest else HIDDEN_REST, voice=voice, staff=staff)
            _add(part, rest, start, end)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about lengths that no note value has
        return partitura.save_musicxml(part)


def _add_note(
    part: Any, note: Note, note_id: str, voice: int, pieces: Sequence[tuple[int, int]]
) -> None:
    """Add a note to a partitura part, in pieces that are tied."""
    from partitura import score as ps

    name = pitch_name(note.pitch)
    before = None
    for index, (start, end) in enumerate(pieces):
        piece = ps.Note(
            step=name[0],
            alter={"#": 1, "b": -1}.get(name[1]),
            octave=note.pitch // 12 - 1,
            id=f"{note_id}-{index}",
            voice=voice,
            staff=staff_of(note),
        )
        if index == 0 and note.finger != UNKNOWN_FINGER:
            piece.technical = [ps.Fingering(finger_number(note.finger))]
        _add(part, piece, start, end)
        if before is not None:
            before.tie_next, piece.tie_prev = piece, before
        before = piece


def _add(part: Any, event: Any, start: int, end: int) -> None:
    """Add a note or rest to a partitura part, with its note value if there is a usual one."""
    part.add(event, start, end)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        value = event.symbolic_duration or {}
    if value.get("actual_notes", 3) != 3:
        event.symbolic_duration = {}
