"""MIDI files: reading and writing scores, with fingering in the track names.

MIDI has no field for fingers. A score is written with one track for each finger, named by the
pianists' numbers: ``R1`` (right thumb) to ``R5`` (right little), ``L1`` to ``L5``. Notes of which
only the hand is known are in tracks named ``right`` and ``left``, the others in one named
``unlabelled``. Any MIDI program shows these tracks, and they survive editing. Reading takes the
labels from these names; the notes of other tracks have no finger, but a hand if the file tells
which (see :func:`~sb3_piano.music.formats.midi_hands.hands_of_tracks`).

One MIDI track cannot hold two overlapping notes of one pitch: the first release ends both. Where
a score has them on the same finger (or both without), the second goes to a further track,
``R1 2`` or ``unlabelled 2``.

Times are written in ticks of 0.1 ms (coarser in pieces of more than 16 minutes, which would
exceed what pretty_midi reads), so that a score read back differs by half of that at most. A
note or a press of the pedal shorter than a tick lasts one tick. Bar lines are kept to half a tick
as well: the file is at 120 beats a minute throughout, and has a time signature wherever the length
of the bars changes. MIDI begins a bar at 0 s in any case, divides one of more than 8 minutes, and
has bars of 4/4 (2 s) where it says nothing, as for a score without bars.
"""

from __future__ import annotations

import io
import os
import re
from pathlib import Path

import pretty_midi

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.left_out import LeftOut
from sb3_piano.music.formats.midi_bars import meters_of_bars
from sb3_piano.music.formats.midi_events import SUSTAIN_CONTROLLER, MidiContents, parse_midi
from sb3_piano.music.formats.midi_hands import hands_of_tracks
from sb3_piano.music.formats.output import write_score_file
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note, Pedal, merge_pedals
from sb3_piano.music.score import Score

_Label = tuple[int, Hand | None]
"""Finger and hand of the notes of a track."""

_UNLABELLED = "unlabelled"
_TRACK_NAMES: dict[_Label, str] = {
    (finger, hand): name
    for hand in HANDS
    for finger, name in (
        *((finger_of(hand, number), f"{hand[0].upper()}{number}") for number in range(1, 6)),
        (UNKNOWN_FINGER, hand),
    )
}
_TRACK_NAMES[UNKNOWN_FINGER, None] = _UNLABELLED
_LABELS = {name: label for label, name in _TRACK_NAMES.items()}
_ORDER = list(_LABELS)
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
    tracks, each of which begins one, and are of 4/4 until the first. Notes off the keyboard and
    notes without length are left out, with a warning that counts them.

    Raises:
        ScoreError: If there is no such file, it is not MIDI, or no note remains.
        ScoreWarning: Is warned if notes were left out.
    """
    path = Path(path)
    contents = parse_midi(path)
    left_out = LeftOut(empty=list(contents.empty_notes))
    notes = [
        Note(
            onset=note.start,
            offset=note.end,
            pitch=note.pitch,
            velocity=note.velocity,
            finger=finger,
            hand=hand,
        )
        for note, (finger, hand) in _labelled_notes(contents)
        if left_out.is_playable(note.start, note.end, note.pitch)
    ]
    if not notes:
        rest = f", only {left_out}" if str(left_out) else ""
        raise ScoreError(f"MIDI file {str(path)!r} has no notes (drums do not count){rest}.")
    left_out.warn(path)
    end = max(note.offset for note in notes)
    return Score(
        notes=notes,
        pedals=_pedals(contents.pedals, end),
        title=path.stem,
        bars=[line for line in contents.bars if line < end],
    )


def write_midi(score: Score, path: str | os.PathLike[str]) -> None:
    """Write a score as a MIDI file, whole or not at all.

    Raises:
        ScoreError: If the file cannot be written, or the score is longer than 13 hours.
    """
    resolution = _choose_resolution(score)
    midi = pretty_midi.PrettyMIDI(resolution=resolution, initial_tempo=_BEATS_PER_MINUTE)
    tick = 60.0 / _BEATS_PER_MINUTE / resolution
    midi.time_signature_changes = _time_signatures(score, tick, resolution)
    midi.instruments = _label_tracks(score, tick)
    for track in midi.instruments:  # each has a channel of its own, on which alone a pedal acts
        track.control_changes = _control_changes(score, tick)
    contents = io.BytesIO()
    midi.write(contents)
    write_score_file(Path(path), contents.getvalue())


def _labelled_notes(contents: MidiContents) -> list[tuple[pretty_midi.Note, _Label]]:
    tracks = [track for track in contents.midi.instruments if track.notes and not track.is_drum]
    return [
        (note, _label_of(track.name) or (UNKNOWN_FINGER, hand))
        for track, hand in zip(tracks, hands_of_tracks(tracks), strict=True)
        for note in track.notes
    ]


def _label_of(track_name: str) -> _Label | None:
    """Return the label that a track of ours is named by, None for one from elsewhere."""
    name = track_name.strip()
    further = _FURTHER_TRACK.fullmatch(name)
    return _LABELS.get(further[1] if further else name)


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


def _time_signatures(score: Score, tick: float, resolution: int) -> list[pretty_midi.TimeSignature]:
    if not score.bars:
        return []
    end = max(_in_ticks(note, tick)[1] for note in score.notes)
    lines = sorted({round(line / tick) for line in score.bars})
    return [
        pretty_midi.TimeSignature(*meter, start * tick)
        for start, meter in meters_of_bars(lines, end, resolution)
    ]


def _label_tracks(score: Score, tick: float) -> list[pretty_midi.Instrument]:
    """Sort the notes into tracks: right hand, left hand, unlabelled."""
    tracks: dict[tuple[str, int], pretty_midi.Instrument] = {}
    free_from: dict[tuple[str, int, int], int] = {}
    for note in score.notes:
        start, end = _in_ticks(note, tick)
        name, copy = _TRACK_NAMES[note.finger, note.hand], 1
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
