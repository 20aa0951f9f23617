"""Write MIDI files, with fingering in the track names.

MIDI has no field for fingers. Each finger has a track, named by the pianists' numbers: ``R1``
(right thumb) to ``R5`` (right little), ``L1`` to ``L5``. Notes with a hand but no finger are in
tracks named ``right`` and ``left``, all others in one named ``unlabelled``. Any MIDI program shows
these tracks, and they survive editing. A performance has one track named ``Piano`` instead, which
such a program gives to one instrument, with the pedal.

One MIDI track cannot hold two overlapping notes of one pitch: the first release ends both. If two
such notes have the same label, the second goes to a further track, ``R1 2`` or ``unlabelled 2``.

Times are in ticks of 0.1 ms, so a score read back differs by half of that at most. Ticks are
coarser in pieces of more than 16 minutes, because of pretty_midi's limit. Notes and presses of the
pedal last at least one tick. Bar lines are rounded to ticks too: the file has 120 beats a minute,
and a time signature wherever the length of the bars changes. MIDI always begins a bar at 0 s. It
divides bars of more than 8 minutes, and has bars of 4/4 (2 s) by default, also for a score without
bars.
"""

from __future__ import annotations

import io
import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import pretty_midi

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.formats.common import write_score_file
from sb3_piano.music.formats.midi_reading import SUSTAIN_CONTROLLER, TRACK_NAMES
from sb3_piano.music.note import Note, Pedal, merge_pedals
from sb3_piano.music.score import Score

_PIANO = "Piano"
_ORDER = [*TRACK_NAMES.values(), _PIANO]

_BEATS_PER_MINUTE = 120.0
_RESOLUTIONS = (5000, 2500, 1000, 500, 250, 100)
"""Possible ticks per beat; at 120 beats a minute, 5000 make a tick of 0.1 ms."""
_MAX_TICKS = 9_900_000
"""pretty_midi refuses to read files of more than 1e7 ticks."""

_DENOMINATORS = (4, 8, 16, 32, 64)
_LONG_DENOMINATORS = (4, 2, 1)
_MOST_BEATS = 255
"""The numerator of a time signature is one byte."""


def write_midi(score: Score, path: str | os.PathLike[str], *, by_finger: bool = True) -> None:
    """Write a score as a MIDI file, atomically.

    Args:
        score: The score.
        path: The file.
        by_finger: Whether each finger has a track of its own, as above; otherwise all notes and the
            pedal are in one track, and labels are lost.

    Raises:
        ScoreError: If the file cannot be written, or the score is longer than 13 hours.
    """
    resolution = _choose_resolution(score)
    midi = pretty_midi.PrettyMIDI(resolution=resolution, initial_tempo=_BEATS_PER_MINUTE)
    tick = 60.0 / _BEATS_PER_MINUTE / resolution
    midi.time_signature_changes = list(_time_signatures(score, tick, resolution))
    midi.instruments = _tracks(score, tick, by_finger)
    pedals = pedals_in_ticks(score, tick)
    for track in midi.instruments:  # a pedal acts on its channel alone, and each track has one
        track.control_changes = control_changes(pedals)
    contents = io.BytesIO()
    midi.write(contents)
    write_score_file(Path(path), contents.getvalue())


def _choose_resolution(score: Score) -> int:
    last = max([score.duration, *(pedal.offset for pedal in score.pedals)])
    beats = last * _BEATS_PER_MINUTE / 60.0
    for resolution in _RESOLUTIONS:
        if beats * resolution < _MAX_TICKS:
            return resolution
    raise ScoreError(
        f"Score {score.title!r} lasts {last:g} s, too long for a MIDI file: expected less than "
        f"{_MAX_TICKS / _RESOLUTIONS[-1] / _BEATS_PER_MINUTE * 60.0:g} s."
    )


def _time_signatures(
    score: Score, tick: float, resolution: int
) -> Iterator[pretty_midi.TimeSignature]:
    """Yield time signatures whose bars begin at the score's bar lines.

    The start of the piece is a bar line too, as MIDI cannot start within a bar.
    """
    if not score.bars:
        return
    end = max(in_ticks(note, tick)[1] for note in score.notes)
    lines = {0, end, *(round(line / tick) for line in score.bars)}
    running, running_ticks = None, 0.0
    for start, stop in itertools.pairwise(sorted(line for line in lines if line <= end)):
        if stop == end and running_ticks >= stop - start:
            return
        meter = _meter_of(stop - start, resolution)
        if meter != running:
            yield pretty_midi.TimeSignature(*meter, start * tick)
        ticks = 4 * resolution * meter[0] / meter[1]
        running, running_ticks = (meter, ticks) if ticks == stop - start else (None, 0.0)


def _tracks(score: Score, tick: float, by_finger: bool) -> list[pretty_midi.Instrument]:
    """Distribute the notes to tracks: right hand, left hand, unlabelled; or put all into one."""
    tracks: dict[tuple[str, int], pretty_midi.Instrument] = {}
    free_from: dict[tuple[str, int, int], int] = {}
    for note in score.notes:
        start, end = in_ticks(note, tick)
        name, copy = TRACK_NAMES[note.finger, note.hand] if by_finger else _PIANO, 1
        while free_from.get((name, copy, note.pitch), 0) > start:
            copy += 1
        free_from[name, copy, note.pitch] = end
        if (name, copy) not in tracks:
            full_name = f"{name} {copy}" if copy > 1 else name
            tracks[name, copy] = pretty_midi.Instrument(program=0, name=full_name)
        tracks[name, copy].notes.append(
            pretty_midi.Note(note.velocity, note.pitch, start * tick, end * tick)
        )
    return [tracks[at] for at in sorted(tracks, key=lambda at: (_ORDER.index(at[0]), at[1]))]


def control_changes(pedals: Iterable[Pedal]) -> list[pretty_midi.ControlChange]:
    """Convert presses of the pedal to MIDI events."""
    return [
        pretty_midi.ControlChange(SUSTAIN_CONTROLLER, value, time)
        for pedal in pedals
        for value, time in ((127, pedal.onset), (0, pedal.offset))
    ]


def pedals_in_ticks(score: Score, tick: float) -> tuple[Pedal, ...]:
    """Round the presses of the pedal to ticks of ``tick`` seconds, at least one each."""
    spans = [in_ticks(pedal, tick) for pedal in score.pedals]
    return merge_pedals(Pedal(onset=down * tick, offset=up * tick) for down, up in spans)


def in_ticks(event: Note | Pedal, tick: float) -> tuple[int, int]:
    """Convert an event to ticks of ``tick`` seconds; its end is at least one tick later."""
    start, end = round(event.onset / tick), round(event.offset / tick)
    return start, max(end, start + 1)


def _meter_of(ticks: int, ticks_per_beat: int) -> tuple[int, int]:
    """Return numerator and denominator of a meter as long as a bar, or the next longer one."""
    for denominator in _DENOMINATORS:
        beats, rest = divmod(ticks * denominator, 4 * ticks_per_beat)
        if rest == 0 and beats <= _MOST_BEATS:
            return beats, denominator
    for denominator in _LONG_DENOMINATORS:
        beats = -(-ticks * denominator // (4 * ticks_per_beat))
        if beats <= _MOST_BEATS:
            break
    return min(beats, _MOST_BEATS), denominator
