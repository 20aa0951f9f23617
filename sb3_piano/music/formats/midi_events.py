"""What pretty_midi needs help with when it reads a MIDI file.

pretty_midi takes tempo and meter from the first track only, drops controllers of tracks without
notes, drops notes that have no length or are never released, and takes a beat within 1e-5 of its
time from the start (36 ms after an hour) for the place of a new meter. The file is therefore gone
through once, message by message, before pretty_midi sees it, and bars are counted in ticks.
"""

from __future__ import annotations

import itertools
import os
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mido  # type: ignore[import-untyped]
import pretty_midi

from sb3_piano.exceptions import ScoreError

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


@dataclass(frozen=True, kw_only=True)
class MidiContents:
    """A parsed MIDI file.

    Attributes:
        midi: The file as pretty_midi reads it: its notes, and the names of its tracks.
        pedals: Presses of the sustain pedal in any track, (down, up) in s, up None if the pedal
            is never released. Neither sorted nor merged.
        bars: When each bar begins, in s, ascending. Each time signature, in any track, begins one;
            until the first the meter is 4/4. Empty if there are more than anybody has written.
        empty_notes: Notes that are struck and released at one moment: (time in s, pitch).
    """

    midi: pretty_midi.PrettyMIDI
    pedals: list[tuple[float, float | None]]
    bars: list[float]
    empty_notes: list[tuple[float, int]]


def parse_midi(path: Path) -> MidiContents:
    """Parse a MIDI file.

    Raises:
        ScoreError: If there is no such file, or it is not a MIDI file.
    """
    if not os.path.isfile(path):
        raise ScoreError(f"There is no MIDI file {str(path)!r}: expected an existing file.")
    try:
        file = mido.MidiFile(filename=str(path))
        scan = _Scan()
        for track in file.tracks:
            scan.read(track)
        file.tracks[:] = [_tempo_track(file.tracks), *(track for track in file.tracks if track)]
        midi = _read_notes(file)
        pedals = [
            (_seconds(midi, down), None if up is None else _seconds(midi, up))
            for down, up in scan.pedals
        ]
        lines = list(itertools.islice(scan.bars(file.ticks_per_beat), _MOST_BARS + 1))
        bars = [_seconds(midi, tick) for tick in lines] if len(lines) <= _MOST_BARS else []
        empty = [(_seconds(midi, tick), pitch) for tick, pitch in scan.empty_notes]
    except Exception as error:
        # A damaged file surfaces as whatever the parser happens to stumble over.
        raise ScoreError(
            f"Cannot read {str(path)!r} as a MIDI file ({str(error) or type(error).__name__}): "
            "expected a complete standard MIDI file."
        ) from error
    return MidiContents(midi=midi, pedals=pedals, bars=bars, empty_notes=empty)


@dataclass
class _Scan:
    """What one pass over the messages finds, in ticks from the start of the file."""

    pedals: list[tuple[int, int | None]] = field(default_factory=list)
    empty_notes: list[tuple[int, int]] = field(default_factory=list)
    meters: dict[int, tuple[int, int]] = field(default_factory=lambda: {0: _COMMON_TIME})
    end: int = 0

    def read(self, track: mido.MidiTrack) -> None:
        """Go through a track, and release at its end what it leaves sounding."""
        sounding: dict[tuple[int, int], list[int]] = {}
        pedal_down: dict[int, int] = {}
        for tick, message in _absolute(track):
            if message.type == "time_signature":
                self._read_meter(tick, message)
            if message.is_meta or getattr(message, "channel", _DRUM_CHANNEL) == _DRUM_CHANNEL:
                continue
            if message.type in ("note_on", "note_off"):
                self._read_note(tick, message, sounding)
            elif message.is_cc(SUSTAIN_CONTROLLER):
                self._read_pedal(tick, message, pedal_down)
        self.pedals += [(down, None) for down in pedal_down.values()]
        for channel, pitch in sounding:
            track.append(mido.Message("note_off", channel=channel, note=pitch, time=0))
        end = sum(message.time for message in track)
        self.end = max(self.end, end)
        self.empty_notes += [
            (start, pitch)
            for (_, pitch), starts in sounding.items()
            for start in starts
            if start == end
        ]

    def bars(self, ticks_per_beat: int) -> Iterator[int]:
        """Yield the tick with which each bar begins, before the end of the longest track."""
        starts = sorted(self.meters)
        for start, end in itertools.pairwise([*starts, self.end]):
            numerator, denominator = self.meters[start]
            length = max(4 * ticks_per_beat * numerator / denominator, 1)
            for bar in itertools.count():
                tick = start + round(bar * length)
                if tick >= end:
                    break
                yield tick

    def _read_meter(self, tick: int, message: mido.MetaMessage) -> None:
        if message.numerator > 0 and message.denominator <= _SHORTEST_BEAT:
            self.meters[tick] = (message.numerator, message.denominator)

    def _read_note(
        self, tick: int, message: mido.Message, sounding: dict[tuple[int, int], list[int]]
    ) -> None:
        at = (message.channel, message.note)
        if message.type == "note_on" and message.velocity > 0:
            sounding.setdefault(at, []).append(tick)
            return
        starts = sounding.pop(at, [])
        struck_now = [start for start in starts if start == tick]
        if len(struck_now) < len(starts) and struck_now:
            # The release belongs to the earlier strike, written after the new one.
            sounding[at] = struck_now
        else:
            self.empty_notes += [(start, message.note) for start in struck_now]

    def _read_pedal(self, tick: int, message: mido.Message, pedal_down: dict[int, int]) -> None:
        if message.value >= _PEDAL_DOWN_FROM:
            pedal_down.setdefault(message.channel, tick)
        elif message.channel in pedal_down:
            self.pedals.append((pedal_down.pop(message.channel), tick))


def _absolute(track: mido.MidiTrack) -> Iterator[tuple[int, Any]]:
    tick = 0
    for message in track:
        tick += message.time
        yield tick, message


def _tempo_track(tracks: list[mido.MidiTrack]) -> mido.MidiTrack:
    """Gather the tempo changes of all tracks where pretty_midi looks for them."""
    changes = sorted(
        (
            (tick, message.tempo)
            for track in tracks
            for tick, message in _absolute(track)
            if message.type == "set_tempo"
        ),
        key=lambda change: change[0],
    )
    gathered, last = mido.MidiTrack(), 0
    for tick, tempo in changes:
        gathered.append(mido.MetaMessage("set_tempo", tempo=tempo, time=tick - last))
        last = tick
    gathered.append(mido.MetaMessage("end_of_track", time=0))
    return gathered


def _read_notes(file: mido.MidiFile) -> pretty_midi.PrettyMIDI:
    if file.ticks_per_beat <= 0:
        raise ValueError("its times are not in ticks per beat")
    with warnings.catch_warnings():
        # About tempo changes outside the first track, which are gathered there by now.
        warnings.simplefilter("ignore", RuntimeWarning)
        return pretty_midi.PrettyMIDI(mido_object=file)


def _seconds(midi: pretty_midi.PrettyMIDI, tick: int) -> float:
    return float(midi.tick_to_time(tick))
