"""Writing MusicXML, the format of notation programs, with partitura.

The score is written as a piano's: staff 1 for the right hand, staff 2 for the left. Notes that
overlap are in voices of their own; those that last beyond a bar line are tied. partitura makes the
document; the title, tempo, velocities and presses of the pedal are put into it afterwards, since
it misspells the first, rounds the second and leaves out the third and the end of the fourth.
"""

from __future__ import annotations

import math
import os
from fractions import Fraction
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.musicxml.container import packed
from sb3_piano.music.formats.musicxml.document import partitura_document
from sb3_piano.music.formats.musicxml.finish import finished
from sb3_piano.music.formats.musicxml.measures import Grid, measures_of
from sb3_piano.music.formats.musicxml.read import require_partitura
from sb3_piano.music.formats.musicxml.tempo import DEFAULT_TEMPO, likely_tempo
from sb3_piano.music.formats.output import write_score_file
from sb3_piano.music.score import Score


def write_musicxml(
    score: Score, path: str | os.PathLike[str], *, tempo: float | None = DEFAULT_TEMPO
) -> None:
    """Write a score as a MusicXML file, whole or not at all; compressed if it ends in ``.mxl``.

    Pitches, fingers, hands and velocities come back as they were, times to half a tick: a tick is
    1/12000 of a quarter note, 0.04 ms at 120 to the minute. A score read back and written again
    comes back exactly. The file has no unknown hand: where it is, the note goes to the right
    hand's staff from middle C on and to the left hand's below.

    The bars of the score are the measures, to the nearest 128th (8 ms at 120), those from its end
    on left out; without any, a measure has four quarter notes. What values the notes are drawn in
    depends on `tempo`, nothing else does.

    Args:
        score: What is written.
        path: The file.
        tempo: Quarter notes per minute that the notes are counted in, finite and above 0; None for
            the one in which the score is most legible (:func:`likely_tempo`).

    Raises:
        ScoreError: If partitura is not installed, `tempo` is out of range, or the file cannot be
            written.
    """
    tempo = likely_tempo(score) if tempo is None else tempo
    if not (math.isfinite(tempo) and tempo > 0):
        raise ScoreError(f"Tempo {tempo} is out of range: expected a finite number above 0.")
    require_partitura()
    path, grid = Path(path), Grid(tempo=Fraction(str(float(tempo))))
    measures = measures_of(score, grid)
    document = finished(partitura_document(score, grid, measures), score, grid, measures)
    write_score_file(path, packed(document) if path.suffix.lower() == ".mxl" else document)
