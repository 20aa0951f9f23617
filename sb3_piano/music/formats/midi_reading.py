"""Read MIDI files: notes, pedal, bars, and labels from the names of the tracks.

A track name from :mod:`~sb3_piano.music.formats.midi_writing` gives the finger of its notes. Other
tracks give no finger, but a hand if it can be inferred.
"""

from __future__ import annotations

import bisect
import itertools
import os
import re
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from sb3_piano.exceptions import ScoreError, ScoreWarning
from sb3_piano.files import read_file
from sb3_piano.music.constants import UNKNOWN_FINGER
from sb3_piano.music.formats.common import LeftOut
from sb3_piano.music.formats.midi_chunks import META, Event, MidiFile, Track, parse_midi
from sb3_piano.music.formats.midi_hands import MidiNote, MidiTrack, hands_of_tracks
from sb3_piano.music.hands import HANDS, Hand, finger_of
from sb3_piano.music.note import Note, Pedal
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import reading

SUSTAIN_CONTROLLER = 64
"""MIDI controller number of the sustain pedal."""

_PEDAL_DOWN_FROM = 64
"""Least value (0-127) of a pedal that is down (MIDI 1.0; equal to the number by chance)."""

_DRUM_CHANNEL = 9

_COMMON_TIME = (4, 4)
"""Default meter of a file (MIDI 1.0)."""

_SHORTEST_BEAT = 6
"""Exponent of the shortest beat, a 64th; meters in shorter notes are damage and ignored."""

_MOST_BARS = 100_000
"""Limit of bars, beyond which a file is damaged: at one every half second they last 14 hours."""

_SEQUENCES = 2
"""Format of files in which each track is a piece (MIDI 1.0)."""

_NOTE_OFF, _NOTE_ON, _CONTROL, _PROGRAM = 0x80, 0x90, 0xB0, 0xC0
"""Statuses of the messages that are read, on channel 0."""

_TRACK_NAME, _TEMPO, _METER = META | 0x03, META | 0x51, META | 0x58

_RESET_CONTROLLERS = 121
_ENDS_ALL_NOTES = frozenset({120, 123, 124, 125, 126, 127})
"""All sound off, all notes off, and mode changes, which imply it (MIDI 1.0)."""

_Place = tuple[int, int, int]
"""Program, channel and index of a track."""

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

    All tracks but drums are read as piano. A release ends all sounding notes of its pitch, channel
    and track. Without such a note, it ends notes in other tracks that have no release of their own.
    Controllers that silence a channel end its notes in all tracks. A note without a release lasts
    until the end of its track. The sustain pedal (controller 64, down from 64 on) is down while any
    track holds it; without a release, it lasts until the end of the last note. Bars follow the time
    signatures of all tracks, each of which starts a bar; before the first they are of 4/4. Notes
    off the keyboard or without length are left out, with a warning that counts them.

    Raises:
        ScoreError: If there is no such file, it is not MIDI, or no note remains.
        ScoreWarning: If notes were left out, or messages are malformed.
    """
    path = Path(path)
    reader = _Reader()
    with reading(path, "MIDI file", "a complete standard one"):
        file = parse_midi(read_file(path))
        if file.kind == _SEQUENCES and len(file.tracks) > 1:
            raise ValueError(f"it holds {len(file.tracks)} pieces, one a track (format 2)")
        tempos, meters, malformed = _signs(file.tracks)
        seconds = _seconds(tempos, file)
        for index, track in enumerate(file.tracks):
            reader.read(index, track)
        reader.finish()
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
        for note, (finger, hand) in _labelled_notes(reader.tracks)
        for onset, offset in [(seconds(note.start), seconds(note.end))]
        if left_out.is_playable(onset, offset, note.pitch)
    ]
    if not notes:
        raise ScoreError(
            f"MIDI file {str(path)!r} has no notes (drums do not count){left_out.only}."
        )
    left_out.warn(path)
    _warn_of_malformed(path, malformed + file.malformed)
    end = max(note.offset for note in notes)
    presses = [(seconds(a), end if b is None else seconds(b)) for a, b in reader.pedals]
    lines = list(itertools.islice(_bars(meters, file), _MOST_BARS + 1))
    bars = [seconds(tick) for tick in lines] if len(lines) <= _MOST_BARS else []
    return Score(
        notes=notes,
        pedals=[Pedal(onset=down, offset=up) for down, up in presses if up > down],
        title=path.stem,
        bars=[line for line in bars if line < end],
    )


def _signs(tracks: Sequence[Track]) -> tuple[dict[int, int], dict[int, tuple[int, int]], int]:
    """Return tempos, in us a beat, and meters by tick, and the number of malformed ones."""
    tempos: dict[int, int] = {}
    meters = {0: _COMMON_TIME}
    malformed = 0
    for tick, status, data in itertools.chain.from_iterable(track.events for track in tracks):
        if status == _TEMPO:
            tempo = int.from_bytes(data[:3], "big") if len(data) >= 3 else 0
            if tempo:
                tempos[tick] = tempo
            malformed += not tempo
        elif status == _METER:
            if len(data) >= 2 and data[0] > 0 and data[1] <= _SHORTEST_BEAT:
                meters[tick] = (data[0], 2 ** data[1])
            malformed += len(data) < 2
    return tempos, meters, malformed


def _warn_of_malformed(path: Path, count: int) -> None:
    if count:
        messages = "1 malformed message" if count == 1 else f"{count} malformed messages"
        warnings.warn(
            f"{str(path)!r} has {messages}: a tempo or meter without value is ignored, data above "
            "127 are read as 127, what follows the end of a track is left out.",
            ScoreWarning,
            stacklevel=3,
        )


def _seconds(tempos: Mapping[int, int], file: MidiFile) -> Callable[[int], float]:
    """Make the function from ticks to seconds from the tempo changes of all tracks."""
    if file.ticks_per_second:
        return lambda tick: tick / file.ticks_per_second
    starts, times, lengths = [0], [0.0], [60.0 / (120.0 * file.ticks_per_beat)]
    for tick, tempo in sorted(tempos.items()):
        length = 60.0 / ((6e7 / tempo) * file.ticks_per_beat)
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


def _bars(meters: Mapping[int, tuple[int, int]], file: MidiFile) -> Iterator[int]:
    """Yield the first tick of each bar, up to the end of the longest track."""
    if not file.ticks_per_beat:
        return
    last = max(track.end for track in file.tracks)
    for start, end in itertools.pairwise([*sorted(meters), last]):
        numerator, denominator = meters[start]
        length = max(4 * file.ticks_per_beat * numerator / denominator, 1)
        for bar in itertools.count():
            tick = start + round(bar * length)
            if tick >= end:
                break
            yield tick


class _Reader:
    """Collects notes and pedals of all tracks.

    Attributes:
        empty: Notes struck and released at the same tick: (tick, pitch).
        pedals: Presses of the sustain pedal, (down, up); up is None without a release.
    """

    def __init__(self) -> None:
        self._tracks: dict[_Place, MidiTrack] = {}
        self.empty: list[tuple[int, int]] = []
        self.pedals: list[tuple[int, int | None]] = []
        # Notes and pedals left open by a track, and the events of other tracks that may end them.
        self._open: list[tuple[_Place, MidiNote]] = []
        self._open_pedals: list[tuple[int, int]] = []
        self._releases: dict[tuple[int, int], list[int]] = defaultdict(list)
        self._silences: dict[int, list[int]] = defaultdict(list)
        self._lifts: dict[int, list[int]] = defaultdict(list)

    @property
    def tracks(self) -> list[MidiTrack]:
        """Tracks with notes, one for each program on a channel, without drums."""
        return [track for track in self._tracks.values() if track.notes]

    def read(self, index: int, track: Track) -> None:
        """Read the messages of a track."""
        self._index, self._name, self._programs = index, "", [0] * 16
        self._sounding: dict[tuple[int, int], list[tuple[int, int]]] = {}
        self._down: dict[int, int] = {}
        for event in track.events:
            if event.status == _TRACK_NAME:
                self._name = event.data.decode("latin-1")
            elif event.status < META and event.status & 0x0F != _DRUM_CHANNEL:
                self._read_message(event)
        for (channel, pitch), struck in self._sounding.items():
            at = self._track_of(channel)
            self._open += [
                (at, MidiNote(tick, track.end, pitch, velocity)) for tick, velocity in struck
            ]
        self._open_pedals += self._down.items()

    def finish(self) -> None:
        """End open notes and pedals, after all tracks are read."""
        for ticks in (*self._releases.values(), *self._silences.values(), *self._lifts.values()):
            ticks.sort()
        for at, note in self._open:
            released = _next(self._releases[at[1], note.pitch], note.start)
            self._add(at, note if released is None else note._replace(end=released))
        for (_, channel, _), track in self._tracks.items():
            silences = self._silences[channel]
            ends = (_next(silences, note.start) for note in track.notes)
            track.notes = [
                note if end is None or end > note.end else note._replace(end=end)
                for note, end in zip(track.notes, ends, strict=True)
            ]
        self.pedals += [(down, _next(self._lifts[ch], down)) for ch, down in self._open_pedals]

    def _read_message(self, event: Event) -> None:
        tick, status, data = event
        channel = status & 0x0F
        kind = status & 0xF0
        if kind == _PROGRAM:
            self._programs[channel] = data[0]
        elif kind == _NOTE_ON and data[1] > 0:
            self._sounding.setdefault((channel, data[0]), []).append((tick, data[1]))
        elif kind in (_NOTE_ON, _NOTE_OFF):
            self._release(tick, channel, data[0])
        elif kind == _CONTROL:
            self._control(tick, channel, *data)

    def _control(self, tick: int, channel: int, number: int, value: int) -> None:
        if number == SUSTAIN_CONTROLLER and value >= _PEDAL_DOWN_FROM:
            self._down.setdefault(channel, tick)
        elif number in (SUSTAIN_CONTROLLER, _RESET_CONTROLLERS):
            if channel in self._down:
                self.pedals.append((self._down.pop(channel), tick))
            else:
                self._lifts[channel].append(tick)
        elif number in _ENDS_ALL_NOTES:
            self._silences[channel].append(tick)

    def _release(self, tick: int, channel: int, pitch: int) -> None:
        struck = self._sounding.pop((channel, pitch), [])
        if not struck:
            self._releases[channel, pitch].append(tick)
            return
        now = [strike for strike in struck if strike[0] == tick]
        before = [strike for strike in struck if strike[0] != tick]
        for start, velocity in before:
            self._add(self._track_of(channel), MidiNote(start, tick, pitch, velocity))
        if before and now:
            # The release belongs to the earlier strike, but is written after the new one.
            self._sounding[channel, pitch] = now
        else:
            self.empty += [(tick, pitch) for _ in now]

    def _track_of(self, channel: int) -> _Place:
        at = (self._programs[channel], channel, self._index)
        self._tracks.setdefault(at, MidiTrack(self._name, at[0]))
        return at

    def _add(self, at: _Place, note: MidiNote) -> None:
        if note.end > note.start:
            self._tracks[at].notes.append(note)
        else:
            self.empty.append((note.start, note.pitch))


def _next(ticks: Sequence[int], start: int) -> int | None:
    """Return the first of the sorted ticks after ``start``, or None."""
    place = bisect.bisect_right(ticks, start)
    return ticks[place] if place < len(ticks) else None


def _labelled_notes(tracks: list[MidiTrack]) -> list[tuple[MidiNote, _Label]]:
    return [
        (note, _label_of(track.name) or (UNKNOWN_FINGER, hand))
        for track, hand in zip(tracks, hands_of_tracks(tracks), strict=True)
        for note in track.notes
    ]


def _label_of(track_name: str) -> _Label | None:
    """Parse the label in the name of a track of ours; None for other tracks."""
    name = track_name.strip()
    further = _FURTHER_TRACK.fullmatch(name)
    return _LABELS.get(further[1] if further else name)
