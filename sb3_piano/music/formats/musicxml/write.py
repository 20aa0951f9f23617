"""Write MusicXML, the format of notation programs.

The score becomes a piano part: staff 1 for the right hand, staff 2 for the left. Overlapping notes
are in separate voices; notes that last beyond a bar line are tied.
"""

from __future__ import annotations

import bisect
import io
import itertools
import math
import os
import zipfile
from collections import defaultdict
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import DEFAULT_VELOCITY, UNKNOWN_FINGER
from sb3_piano.music.formats.common import write_score_file
from sb3_piano.music.formats.musicxml.document import CONTAINER_NAME
from sb3_piano.music.formats.musicxml.notes import FORTE
from sb3_piano.music.formats.musicxml.tempo import DEFAULT_TEMPO, likely_tempo
from sb3_piano.music.hands import HANDS, finger_number, likely_hand
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.pitch import pitch_name
from sb3_piano.music.score import Score

_DIVISIONS = 12_000
"""Ticks in a quarter note: thirds, fifths, 64ths, and 1 ms at 120 to the minute are whole.

Notation programs accept at most 16383.
"""

_WHOLE = 4 * _DIVISIONS
_BEAT_TYPES = (4, 8, 16, 32, 64, 128)
_LINE_STEP = _WHOLE // _BEAT_TYPES[-1]
"""A bar line is at a whole 128th, so that each measure has a meter."""

_VOICES_OF_A_STAFF = 4
"""Number of voices in notation programs; more are written only if the notes need them."""

_NAMES = ("whole", "half", "quarter", "eighth", "16th", "32nd", "64th")
_VALUES = {
    ticks: (name, dots, is_triplet)
    for index, name in enumerate(_NAMES)
    for whole in [_WHOLE // 2**index]
    for ticks, dots, is_triplet in (
        (whole * 2 // 3, 0, True),
        (whole * 3 // 2, 1, False),
        (whole, 0, False),
    )
}
"""Note value, dots and whether it is a triplet's, by the length in ticks."""

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<!DOCTYPE score-partwise PUBLIC "-//Recordare//DTD MusicXML 3.1 Partwise//EN" '
    '"http://www.musicxml.org/dtds/partwise.dtd">\n'
)
_FILE = "score.musicxml"
_CONTAINER = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<container><rootfiles>'
    f'<rootfile full-path="{_FILE}" media-type="application/vnd.recordare.musicxml+xml"/>'
    "</rootfiles></container>\n"
)

_Span = tuple[int, int]
"""First tick of an event, and the first after it."""


def write_musicxml(
    score: Score, path: str | os.PathLike[str], *, tempo: float | None = DEFAULT_TEMPO
) -> None:
    """Write a score as a MusicXML file, atomically; compressed if it ends in ``.mxl``.

    Pitches, fingers, hands and velocities are preserved, times to half a tick: a tick is 1/12000 of
    a quarter note, 0.04 ms at 120 to the minute. A score read back and written again is preserved
    exactly. The file has no unknown hand: such a note goes to the right hand's staff from middle C
    up, and to the left hand's below.

    The bars of the score are the measures, to the nearest 128th (8 ms at 120), without bars from
    its end on; without any, a measure has four quarter notes. `tempo` only changes the note values
    that are drawn.

    Args:
        score: The score.
        path: The file.
        tempo: Quarter notes per minute for the note values, finite and above 0; None for the most
            legible tempo (:func:`likely_tempo`).

    Raises:
        ScoreError: If `tempo` is out of range, or the file cannot be written.
    """
    tempo = likely_tempo(score) if tempo is None else tempo
    if not (math.isfinite(tempo) and tempo > 0):
        raise ScoreError(f"Tempo {tempo} is out of range: expected a finite number above 0.")
    path = Path(path)
    document = _document(score, Fraction(str(float(tempo))))
    write_score_file(path, _packed(document) if path.suffix.lower() == ".mxl" else document)


class _Measure(NamedTuple):
    """A measure: its first tick, the first after it, and its meter."""

    start: int
    end: int
    meter: tuple[int, int]
    is_pickup: bool


def _measures(bars: Sequence[int], end_of_notes: int, last: int) -> list[_Measure]:
    """Compute the measures, by the ticks of bars, or of four quarter notes without bars.

    Bar lines are rounded to 128ths; bars without length are then left out. The last measure extends
    to the end of all notes and pedals.
    """
    lines = {round(bar / _LINE_STEP) * _LINE_STEP for bar in bars}
    lines = {line for line in lines if line < end_of_notes} or set(range(0, last, _WHOLE))
    starts = sorted({0, *lines})
    usual = starts[-1] - starts[-2] if len(starts) > 1 else _WHOLE
    rest = last - starts[-1]
    end = starts[-1] + (usual if usual >= rest else -(-rest // _DIVISIONS) * _DIVISIONS)
    spans = list(itertools.pairwise([*starts, end]))
    meters = [_meter(stop - start) for start, stop in spans]
    has_pickup = 0 not in lines
    if has_pickup and starts[1] < (spans[1][1] - starts[1]):
        meters[0] = meters[1]
    return [
        _Measure(start, stop, meter, is_pickup=has_pickup and start == 0)
        for (start, stop), meter in zip(spans, meters, strict=True)
    ]


def _meter(ticks: int) -> tuple[int, int]:
    """Return the meter of a measure, in the longest possible beats."""
    beat_type = next(kind for kind in _BEAT_TYPES if ticks * kind % _WHOLE == 0)
    return ticks * beat_type // _WHOLE, beat_type


_Chord = list[tuple[Note, bool, bool]]
"""Notes that start and end together, each with its ties to the note before and after."""

_TEMPO = (
    '<direction placement="above"><direction-type><metronome><beat-unit>quarter</beat-unit>'
    "<per-minute>{tempo:g}</per-minute></metronome></direction-type>"
    '<sound tempo="{tempo!r}"/></direction>'
)
_PEDAL = (
    '<direction placement="below"><direction-type><pedal type="{kind}"/></direction-type>'
    "<staff>2</staff></direction>"
)
_STAVES = (
    '<staves>2</staves><clef number="1"><sign>G</sign><line>2</line></clef>'
    '<clef number="2"><sign>F</sign><line>4</line></clef>'
)


def _document(score: Score, tempo: Fraction) -> bytes:
    def tick(time: float) -> int:
        return round(Fraction(time) * tempo * _DIVISIONS / 60)

    def spans(events: Sequence[Note | Pedal]) -> list[_Span]:
        ticks = [(tick(event.onset), tick(event.offset)) for event in events]
        return [(start, max(end, start + 1)) for start, end in ticks]

    note_spans, pedal_spans = spans(score.notes), spans(score.pedals)
    ends = [max(end for _, end in many) for many in (note_spans, note_spans + pedal_spans)]
    measures = _measures([tick(line) for line in score.bars], *ends)
    lines = [measure.start for measure in measures]
    first_voices, struck = _struck(score.notes, note_spans, lines)
    pedals = _pedal_marks(pedal_spans, lines)
    title = escape(score.title)
    texts = [
        f"{_HEAD}<score-partwise><work><work-title>{title}</work-title></work><part-list>"
        '<score-part id="P1"><part-name>Piano</part-name></score-part></part-list><part id="P1">'
    ]
    meter = None
    for number, measure in enumerate(measures, start=int(not measures[0].is_pickup)):
        implicit = ' implicit="yes"' if measure.is_pickup else ""
        texts.append(f'<measure number="{number}"{implicit}>')
        if measure.meter != meter:
            texts.append(_attributes(measure.meter, is_first=meter is None))
        if meter is None:
            texts.append(_TEMPO.format(tempo=float(tempo)))
        meter, here = measure.meter, measure.start
        for voice, chords in sorted(struck[measure.start].items()):
            texts.append(_move(here, measure.start))
            text, here = _voice(measure, voice, chords, first_voices)
            texts.append(text)
        for at, kind in pedals[measure.start]:
            texts += [_move(here, at), _PEDAL.format(kind=kind)]
            here = at
        texts += [_move(here, measure.end), "</measure>"]
    texts.append("</part></score-partwise>\n")
    return "\n".join(filter(None, texts)).encode()


def _struck(
    notes: Sequence[Note], spans: Sequence[_Span], lines: Sequence[int]
) -> tuple[tuple[int, int], dict[int, dict[int, dict[_Span, _Chord]]]]:
    """Return the first voice of each staff, and the chords of each measure (by start) and voice.

    A note shares a voice only with notes of exactly the same span.
    """
    last: tuple[list[_Span], list[_Span]] = ([], [])
    chosen = []
    for note, span in zip(notes, spans, strict=True):
        voices = last[_staff(note) - 1]
        free = (i for i, other in enumerate(voices) if other[1] <= span[0])
        joined = (i for i, other in enumerate(voices) if other == span)
        index = next(itertools.chain(joined, free), len(voices))
        voices[index : index + 1] = [span]
        chosen.append(index)
    upper = max(len(last[0]), _VOICES_OF_A_STAFF)
    first_voices = (1, upper + 1)
    struck: dict[int, dict[int, dict[_Span, _Chord]]] = {
        line: {voice: {} for voice in first_voices} for line in lines
    }
    for note, (start, end), index in zip(notes, spans, chosen, strict=True):
        voice = first_voices[_staff(note) - 1] + index
        cuts = lines[bisect.bisect_right(lines, start) : bisect.bisect_left(lines, end)]
        for a, b in itertools.pairwise([start, *cuts, end]):
            of_measure = struck[lines[bisect.bisect_right(lines, a) - 1]]
            chord = of_measure.setdefault(voice, {}).setdefault((a, b), [])
            chord.append((note, a > start, b < end))
    return first_voices, struck


def _staff(note: Note) -> int:
    return HANDS.index(note.hand or likely_hand(note.pitch)) + 1


def _pedal_marks(spans: Sequence[_Span], lines: Sequence[int]) -> dict[int, list[tuple[int, str]]]:
    """Return the pedal marks of each measure, by its start: (tick, start or stop)."""
    marks: list[tuple[int, str]] = []
    for down, up in spans:
        if marks and down <= marks[-1][0]:
            marks.pop()  # no tick is left between them
        else:
            marks.append((down, "start"))
        marks.append((up, "stop"))
    by_measure = defaultdict(list)
    for tick, kind in marks:
        # A stop at the end of a measure is written in that measure.
        place = tick - int(kind == "stop")
        by_measure[lines[bisect.bisect_right(lines, place) - 1]].append((tick, kind))
    return by_measure


def _attributes(meter: tuple[int, int], *, is_first: bool) -> str:
    divisions = f"<divisions>{_DIVISIONS}</divisions>" if is_first else ""
    time = f"<time><beats>{meter[0]}</beats><beat-type>{meter[1]}</beat-type></time>"
    return f"<attributes>{divisions}{time}{_STAVES if is_first else ''}</attributes>"


def _move(here: int, there: int) -> str:
    """Return the element that moves from one tick to another."""
    if there == here:
        return ""
    kind = "forward" if there > here else "backup"
    return f"<{kind}><duration>{abs(there - here)}</duration></{kind}>"


def _voice(
    measure: _Measure, voice: int, chords: Mapping[_Span, _Chord], first_voices: tuple[int, int]
) -> tuple[str, int]:
    """Write the notes and rests of a voice; return them and the final tick.

    Rests fill the first voice of a staff; other voices have hidden rests.
    """
    is_first, staff = voice in first_voices, 1 if voice < first_voices[1] else 2
    hidden = "" if is_first else ' print-object="no"'
    texts, here = [], measure.start
    spans = [*sorted(chords), *([(measure.end, measure.end)] if is_first else [])]
    for start, end in spans:
        if start > here:
            rest = f"<note{hidden}><rest/>"
            texts.append(rest + _placed(start - here, voice, staff) + "</note>")
        for index, (note, *tied) in enumerate(chords.get((start, end), ())):
            texts.append(_note(note, tied, end - start, voice, in_chord=index > 0))
        here = end
    return "\n".join(texts), here


def _note(note: Note, tied: Sequence[bool], ticks: int, voice: int, *, in_chord: bool) -> str:
    name = pitch_name(note.pitch)
    alter = {"#": "<alter>1</alter>", "b": "<alter>-1</alter>"}.get(name[1], "")
    dynamics = f' dynamics="{100 * note.velocity / FORTE:.2f}"'
    ties = [kind for kind, is_tied in zip(("stop", "start"), tied, strict=True) if is_tied]
    notations = "".join(f'<tied type="{kind}"/>' for kind in ties)
    if note.finger != UNKNOWN_FINGER and not tied[0]:
        finger = finger_number(note.finger)
        notations += f"<technical><fingering>{finger}</fingering></technical>"
    return (
        f"<note{'' if note.velocity == DEFAULT_VELOCITY else dynamics}>"
        f"{'<chord/>' if in_chord else ''}<pitch><step>{name[0]}</step>{alter}"
        f"<octave>{note.pitch // 12 - 1}</octave></pitch>"
        f"{_placed(ticks, voice, _staff(note), ties)}"
        f"{f'<notations>{notations}</notations>' if notations else ''}</note>"
    )


def _placed(ticks: int, voice: int, staff: int, ties: Sequence[str] = ()) -> str:
    """Return length, ties, voice, note value and staff of a note or rest."""
    kind, dots, is_triplet = _VALUES.get(ticks, ("", 0, False))
    ratio = "<actual-notes>3</actual-notes><normal-notes>2</normal-notes>"
    value = f"<type>{kind}</type>{'<dot/>' * dots}" if kind else ""
    value += f"<time-modification>{ratio}</time-modification>" if is_triplet else ""
    tied = "".join(f'<tie type="{tie}"/>' for tie in ties)
    return f"<duration>{ticks}</duration>{tied}<voice>{voice}</voice>{value}<staff>{staff}</staff>"


def _packed(document: bytes) -> bytes:
    """Compress the document; equal documents give equal bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in ((CONTAINER_NAME, _CONTAINER.encode()), (_FILE, document)):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
