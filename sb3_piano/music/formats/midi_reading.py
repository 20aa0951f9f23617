"""Reading MIDI files: notes, pedal, bars, and labels from the names of the tracks.

Notes of tracks named as :mod:`~sb3_piano.music.formats.midi_writing` names them have that finger;
those of other tracks have none, but a hand if the file tells which.
"""

from __future__ import annotations

import bisect
import itertools
import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import mido  # type: ignore[import-untyped]

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.common import LeftOut
from sb3_piano.music.formats.meta_messages import read_all_meta_messages
from sb3_piano.music.formats.midi_hands import MidiNote, MidiTrack, hands_of_tracks
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import readable, reading

SUSTAIN_CONTROLLER = 64
"""Number of the sustain pedal among the MIDI controllers."""

_PEDAL_DOWN_FROM = 64
"""Value (0-127) from which a pedal counts as down (MIDI 1.0; the equal number is chance)."""

_DRUM_CHANNEL = 9

_COMMON_TIME = (4, 4)
"""The meter of a file that names none (MIDI 1.0)."""

_SHORTEST_BEAT = 64
"""A meter in shorter notes than 64ths is taken for damage, and ignored."""

_MOST_BARS = 100_000
"""More are taken for damage: at one every half second they last for 14 hours."""

_SEQUENCES = 2
"""Format of files whose tracks are pieces of their own (MIDI 1.0)."""

_Timed = tuple[int, mido.Message]
"""A message, after the tick at which it stands."""

_Label = tuple[int, Hand | None]
"""Finger and hand of the notes of a track."""

_UNLABELLED = "unlabelled"
TRACK_NAMES: dict[_Label, str] = {
    (finger, hand): name
    for hand in HANDS
    for finger, name in (
        *((finger_of(hand, number), f"{hand[0].upper()}{number}") for number in range(1, 6)),
        (UNKNOWN_FINGER, hand),
    )
}
TRACK_NAMES[UNKNOWN_FINGER, None] = _UNLABELLED
_LABELS = {name: label for label, name in TRACK_NAMES.items()}
_FURTHER_TRACK = re.compile(r"(\S+) \d+")


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
    reader = _Reader()
    read_all_meta_messages()
    with reading(path, "MIDI file", "a complete standard one"):
        file = mido.MidiFile(filename=str(path))
        if file.ticks_per_beat <= 0:
            raise ValueError("its times are not in ticks per beat")
        if file.type == _SEQUENCES and len(file.tracks) > 1:
            raise ValueError(f"it holds {len(file.tracks)} pieces, one a track (format 2)")
        tracks = [_in_ticks(track) for track in file.tracks]
        messages = list(itertools.chain.from_iterable(tracks))
        seconds = _seconds(messages, file.ticks_per_beat)
        for index, track in enumerate(tracks):
            reader.read(index, track)
    left_out = LeftOut()
    for tick, pitch in reader.empty:
        left_out.add_empty(seconds(tick), pitch)
    notes = [
        Note(
            onset=onset,
            offset=offset,
            pitch=note.pitch,
            velocity=note.velocity,
            finger=finger,
            hand=hand,
        )
        for note, (finger, hand) in _labelled_notes(list(reader.tracks.values()))
        for onset, offset in [(seconds(note.start), seconds(note.end))]
        if left_out.is_playable(onset, offset, note.pitch)
    ]
    if not notes:
        raise ScoreError(
            f"MIDI file {str(path)!r} has no notes (drums do not count){left_out.only}."
        )
    left_out.warn(path)
    end = max(note.offset for note in notes)
    presses = [(seconds(a), end if b is None else seconds(b)) for a, b in reader.pedals]
    lines = list(itertools.islice(_bars(messages, file.ticks_per_beat), _MOST_BARS + 1))
    bars = [seconds(tick) for tick in lines] if len(lines) <= _MOST_BARS else []
    return Score(
        notes=notes,
        pedals=[Pedal(onset=down, offset=up) for down, up in presses if up > down],
        title=readable(path.stem),
        bars=[line for line in bars if line < end],
    )


def _in_ticks(track: mido.MidiTrack) -> list[_Timed]:
    return list(zip(itertools.accumulate(m.time for m in track), track, strict=True))


def _seconds(messages: Sequence[_Timed], ticks_per_beat: int) -> Callable[[int], float]:
    """Return the function from ticks to seconds, by the tempo changes of all tracks."""
    starts, times, lengths = [0], [0.0], [60.0 / (120.0 * ticks_per_beat)]
    tempos = [(tick, message.tempo) for tick, message in messages if message.type == "set_tempo"]
    for tick, tempo in sorted(tempos, key=lambda change: change[0]):
        length = 60.0 / ((6e7 / tempo) * ticks_per_beat)
        if tick == 0:
            lengths = [length]
        elif length != lengths[-1]:
            times.append(times[-1] + lengths[-1] * (tick - starts[-1]))
            starts.append(tick)
            lengths.append(length)

    def seconds(tick: int) -> float:
        piece = bisect.bisect_right(starts, tick) - 1
        return times[piece] + lengths[piece] * (tick - starts[piece])

    return seconds


def _bars(messages: Sequence[_Timed], ticks_per_beat: int) -> Iterator[int]:
    """Yield the tick with which each bar begins, before the end of the longest track."""
    meters = {0: _COMMON_TIME} | {
        tick: (message.numerator, message.denominator)
        for tick, message in messages
        if message.type == "time_signature"
        and message.numerator > 0
        and message.denominator <= _SHORTEST_BEAT
    }
    last = max(tick for tick, _ in messages)
    for start, end in itertools.pairwise([*sorted(meters), last]):
        numerator, denominator = meters[start]
        length = max(4 * ticks_per_beat * numerator / denominator, 1)
        for bar in itertools.count():
            tick = start + round(bar * length)
            if tick >= end:
                break
            yield tick


class _Reader:
    """Goes through the tracks.

    Attributes:
        tracks: Tracks that have notes, one for each program on a channel; without drums.
        empty: Notes that are struck and released at one moment: (tick, pitch).
        pedals: Presses of the sustain pedal, (down, up), up None if it is never released.
    """

    def __init__(self) -> None:
        self.tracks: dict[tuple[int, int, int], MidiTrack] = {}
        self.empty: list[tuple[int, int]] = []
        self.pedals: list[tuple[int, int | None]] = []

    def read(self, index: int, track: Sequence[_Timed]) -> None:
        """Note what the messages say, and release at the end what is left sounding."""
        self._index, self._name, self._programs = index, "", [0] * 16
        self._sounding: dict[tuple[int, int], list[tuple[int, int]]] = {}
        self._down: dict[int, int] = {}
        tick = 0
        for tick, message in track:
            if message.type == "track_name":
                self._name = message.name
            elif (
                not message.is_meta and getattr(message, "channel", _DRUM_CHANNEL) != _DRUM_CHANNEL
            ):
                self._read_message(tick, message)
        for channel, pitch in list(self._sounding):
            self._release(tick, channel, pitch)
            self.empty += [(tick, pitch) for _ in self._sounding.pop((channel, pitch), [])]
        self.pedals += [(start, None) for start in self._down.values()]

    def _read_message(self, tick: int, message: mido.Message) -> None:
        if message.type == "program_change":
            self._programs[message.channel] = message.program
        elif message.type == "note_on" and message.velocity > 0:
            strikes = self._sounding.setdefault((message.channel, message.note), [])
            strikes.append((tick, message.velocity))
        elif message.type in ("note_on", "note_off"):
            self._release(tick, message.channel, message.note)
        elif message.is_cc(SUSTAIN_CONTROLLER):
            if message.value >= _PEDAL_DOWN_FROM:
                self._down.setdefault(message.channel, tick)
            elif message.channel in self._down:
                self.pedals.append((self._down.pop(message.channel), tick))

    def _release(self, tick: int, channel: int, pitch: int) -> None:
        struck = self._sounding.pop((channel, pitch), [])
        now = [strike for strike in struck if strike[0] == tick]
        before = [strike for strike in struck if strike[0] != tick]
        for start, velocity in before:
            program = self._programs[channel]
            at = (program, channel, self._index)
            notes = self.tracks.setdefault(at, MidiTrack(self._name, program)).notes
            notes.append(MidiNote(start, tick, pitch, velocity))
        if before and now:
            # The release belongs to the earlier strike, written after the new one.
            self._sounding[channel, pitch] = now
        else:
            self.empty += [(tick, pitch) for _ in now]


def _labelled_notes(tracks: list[MidiTrack]) -> list[tuple[MidiNote, _Label]]:
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
