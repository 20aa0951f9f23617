"""MIDI files: reading and writing scores, with fingering in the track names.

MIDI has no field for fingers. A score is written with one track for each finger, named by the
pianists' numbers: ``R1`` (right thumb) to ``R5`` (right little), ``L1`` to ``L5``. Notes without
a label are in a track named ``unlabelled``. Any MIDI program shows these tracks, and they survive
editing. Reading takes the labels from these names; the notes of other tracks are unlabelled.

One MIDI track cannot hold two overlapping notes of one pitch: the first release ends both. Where
a score has them on the same finger (or both unlabelled), the second goes to a further track,
``R1 2`` or ``unlabelled 2``.

Times are written in ticks of 0.1 ms (coarser in pieces of more than 16 minutes, which would
exceed what pretty_midi reads), so that a score read back differs by half of that at most. A
note or a press of the pedal shorter than a tick lasts one tick.
"""

from __future__ import annotations

import io
import os
import re
from pathlib import Path

import pretty_midi

from sb3_piano.exceptions import ScoreError
from sb3_piano.files import write_bytes
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH, NUM_FINGERS, UNKNOWN_FINGER
from sb3_piano.music.formats.midi_events import SUSTAIN_CONTROLLER, parse_midi
from sb3_piano.music.note import Note, Pedal, located_note, merge_pedals
from sb3_piano.music.score import Score

_UNLABELLED = "unlabelled"
_TRACK_NAMES = {
    UNKNOWN_FINGER: _UNLABELLED,
    **{finger: f"{'RL'[finger // 5]}{finger % 5 + 1}" for finger in range(NUM_FINGERS)},
}
_FINGERS = {name: finger for finger, name in _TRACK_NAMES.items()}
_FURTHER_TRACK = re.compile(r"(\S+) \d+")

_BEATS_PER_MINUTE = 120.0
_RESOLUTIONS = (5000, 2500, 1000, 500, 250, 100)
"""Ticks per beat to choose from; at 120 beats a minute, 5000 make a tick of 0.1 ms."""
_MAX_TICKS = 9_900_000
"""pretty_midi refuses to read files of more than 1e7 ticks."""


def read_midi(path: str | os.PathLike[str]) -> Score:
    """Read a MIDI file; its name without the suffix becomes the title.

    All tracks but drums are read as piano. The sustain pedal (controller 64, down from 64 on) is
    down while any track holds it down. A pedal never released lasts until the end of the last
    note, a note never released until the end of its track. Bars go by the time signatures of all
    tracks, each of which begins one, and are of 4/4 until the first.

    Raises:
        ScoreError: If there is no such file, it is not MIDI, it has no notes, or a note has no
            length or lies outside the keyboard.
    """
    path = Path(path)
    contents = parse_midi(path)
    played = sorted(
        (
            (note, _finger_of(instrument.name))
            for instrument in contents.midi.instruments
            if not instrument.is_drum
            for note in instrument.notes
        ),
        key=lambda item: (item[0].start, item[0].pitch),
    )
    _check_pitches([note.pitch for note, _ in played], path)
    notes = [
        located_note(
            f"Note {index} of {str(path)!r}",
            onset=note.start,
            offset=note.end,
            pitch=note.pitch,
            velocity=note.velocity,
            finger=finger,
        )
        for index, (note, finger) in enumerate(played)
    ]
    if not notes:
        raise ScoreError(f"MIDI file {str(path)!r} has no notes (drums do not count).")
    end = max(note.offset for note in notes)
    return Score(
        notes=notes,
        pedals=_pedals(contents.pedals, end),
        title=path.stem,
        bars=[line for line in contents.bars if line < end],
    )


def write_midi(score: Score, path: str | os.PathLike[str]) -> None:
    """Write a score as a MIDI file, whole or not at all.

    Bar lines are not written: the file is in 4/4 at 120 beats a minute, so that the score read
    back has bars of 2 s.

    Raises:
        ScoreError: If the file cannot be written, or the score is longer than 13 hours.
    """
    path = Path(path)
    resolution = _choose_resolution(score)
    midi = pretty_midi.PrettyMIDI(resolution=resolution, initial_tempo=_BEATS_PER_MINUTE)
    tick = 60.0 / _BEATS_PER_MINUTE / resolution
    midi.instruments = _finger_tracks(score, tick)
    for track in midi.instruments:  # each has a channel of its own, on which alone a pedal acts
        track.control_changes = _control_changes(score, tick)
    contents = io.BytesIO()
    midi.write(contents)
    try:
        write_bytes(path, contents.getvalue())
    except OSError as error:
        raise ScoreError(
            f"Cannot write {str(path)!r}: {error.strerror}; expected a file in a writable folder."
        ) from error


def _finger_of(track_name: str) -> int:
    name = track_name.strip()
    further = _FURTHER_TRACK.fullmatch(name)
    return _FINGERS.get(further[1] if further else name, UNKNOWN_FINGER)


def _check_pitches(pitches: list[int], path: Path) -> None:
    outside = [pitch for pitch in pitches if not MIN_PITCH <= pitch <= MAX_PITCH]
    if outside:
        names = [pretty_midi.note_number_to_name(pitch) for pitch in outside[:3]]
        raise ScoreError(
            f"{len(outside)} of {len(pitches)} notes of {str(path)!r} are not on the keyboard, "
            f"first {', '.join(names)}: expected A0 to C8."
        )


def _pedals(presses: list[tuple[float, float | None]], end: float) -> list[Pedal]:
    closed = [(down, end if up is None else up) for down, up in presses]
    return [Pedal(onset=down, offset=up) for down, up in closed if up > down]


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


def _finger_tracks(score: Score, tick: float) -> list[pretty_midi.Instrument]:
    """Sort the notes into tracks: right hand, left hand, unlabelled."""
    tracks: dict[tuple[int, int], pretty_midi.Instrument] = {}
    free_from: dict[tuple[int, int, int], int] = {}
    for note in score.notes:
        start, end = _in_ticks(note, tick)
        copy = 1
        while free_from.get((note.finger, copy, note.pitch), 0) > start:
            copy += 1
        free_from[note.finger, copy, note.pitch] = end
        if (note.finger, copy) not in tracks:
            name = _TRACK_NAMES[note.finger] + (f" {copy}" if copy > 1 else "")
            tracks[note.finger, copy] = pretty_midi.Instrument(program=0, name=name)
        tracks[note.finger, copy].notes.append(
            pretty_midi.Note(note.velocity, note.pitch, start * tick, end * tick)
        )
    return [tracks[at] for at in sorted(tracks, key=lambda at: (at[0] == UNKNOWN_FINGER, at))]


def _control_changes(score: Score, tick: float) -> list[pretty_midi.ControlChange]:
    spans = [_in_ticks(pedal, tick) for pedal in score.pedals]
    whole_ticks = merge_pedals(Pedal(onset=down * tick, offset=up * tick) for down, up in spans)
    return [
        pretty_midi.ControlChange(SUSTAIN_CONTROLLER, value, time)
        for pedal in whole_ticks
        for value, time in ((127, pedal.onset), (0, pedal.offset))
    ]


def _in_ticks(event: Note | Pedal, tick: float) -> tuple[int, int]:
    start, end = round(event.onset / tick), round(event.offset / tick)
    return start, max(end, start + 1)
