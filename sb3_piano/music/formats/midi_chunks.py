"""Parse chunks and messages of MIDI files, also where programs violate the standard.

Libraries refuse a whole file for one odd message that no score needs. This parser skips unknown
chunks, ignores counts and lengths that contradict the bytes, and skips messages that no score
needs. The browser page parses in the same way (``web/src/music/smf.ts``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

META = 0xFF00
"""Base of a meta message's status in an :class:`Event`; the message's type is added."""

_HEADER, _TRACK = b"MThd", b"MTrk"
_HEAD = 8
"""Bytes of a chunk before its contents: four letters and a length."""

_END_OF_TRACK = 0x2F
_NTSC = 29
"""Code of 30,000 frames in 1,001 s (MIDI 1.0)."""

_SYSTEM_DATA = {0xF1: 1, 0xF2: 2, 0xF3: 1}
"""Number of data bytes by system message, 0 if missing."""


class Event(NamedTuple):
    """A channel message or a meta message."""

    tick: int
    status: int
    data: bytes


class Track(NamedTuple):
    """The messages of a track, and its last tick."""

    events: list[Event]
    end: int


@dataclass
class MidiFile:
    """The contents of a file.

    Attributes:
        kind: 0, 1, or 2 (each track is a piece).
        ticks_per_beat: Ticks of a quarter note, 0 if ticks divide a second.
        ticks_per_second: Ticks of a second, 0 if they divide a beat.
        tracks: The tracks.
        malformed: Number of malformed items: channel messages with data above 127, read as 127, and
            tracks that continue after their end.
    """

    kind: int
    ticks_per_beat: int
    ticks_per_second: float
    tracks: list[Track] = field(default_factory=list)
    malformed: int = 0


def parse_midi(data: bytes) -> MidiFile:
    """Parse the bytes of a file; bytes before its header, such as RIFF's, are skipped.

    Raises:
        ValueError: If it has no header or no track, or ends within a message.
    """
    start = data.find(_HEADER)
    if start < 0:
        raise ValueError("it has no MThd, with which a MIDI file begins")
    head = data[start + _HEAD : start + _HEAD + 6]
    if len(head) < 6:
        raise ValueError("it ends within its header")
    file = MidiFile(int.from_bytes(head[:2], "big"), *_division(head[4], head[5]))
    at = _next_chunk(data, start + _HEAD + 6, _end_of_chunk(data, start))
    while at + _HEAD <= len(data) and data[at : at + 4] != _HEADER:
        begin, end = at + _HEAD, _end_of_chunk(data, at)
        if data[at : at + 4] == _TRACK:
            reader = _TrackReader(data, begin, end)
            file.tracks.append(reader.read())
            file.malformed += reader.malformed
            begin = reader.at
        at = _next_chunk(data, begin, end)
    if not file.tracks:
        raise ValueError("it has no track")
    return file


def _division(high: int, low: int) -> tuple[int, float]:
    """Parse the ticks of a beat and of a second; one of them is 0."""
    if high < 0x80 and (high or low):
        return high * 256 + low, 0
    if high < 0x80 or low == 0:
        raise ValueError("its ticks have no length")
    frames = 256 - high
    return 0, (30_000 / 1_001 if frames == _NTSC else frames) * low


def _end_of_chunk(data: bytes, at: int) -> int:
    return at + _HEAD + int.from_bytes(data[at + 4 : at + _HEAD], "big")


def _is_boundary(data: bytes, at: int) -> bool:
    """Return whether a chunk may begin here, or only padding is left."""
    left = len(data) - at
    return 0 <= left < _HEAD or (left > 0 and all(32 <= byte < 127 for byte in data[at : at + 4]))


def _next_chunk(data: bytes, begin: int, end: int) -> int:
    """Find the next chunk: at ``end``, unless the length of the present one is wrong."""
    if data[begin : begin + 4] == _TRACK:
        return begin
    if end >= begin and _is_boundary(data, end):
        return end
    found = data.find(_TRACK, begin)
    return len(data) if found < 0 else found


class _TrackReader:
    """Reads a track's messages from ``at``; ``end`` is its end by the chunk's length."""

    def __init__(self, data: bytes, at: int, end: int) -> None:
        self._data, self.at, self._end = data, at, end
        # A length that leads to another track is right; others may be wrong.
        self._limit = end if data[end : end + 4] == _TRACK else len(data)
        self.malformed = 0

    def read(self) -> Track:
        """Read up to the end-of-track message, which some programs omit."""
        events: list[Event] = []
        tick = running = 0
        while not self._is_over():
            tick += self._number()
            status = self._data[self.at] if self.at < self._limit else 0
            if status >= 0x80:
                self.at += 1
            else:
                status = running
            if status == 0xFF:
                kind = self._take(1)[0]
                contents = self._take(self._number())
                if kind == _END_OF_TRACK:
                    self.malformed += self.at < self._end and _is_boundary(self._data, self._end)
                    break
                events.append(Event(tick, META | kind, contents))
            elif status in (0xF0, 0xF7):
                self._take(self._number())
            elif status > 0xF0:
                self._take(_SYSTEM_DATA.get(status, 0))
            elif status:
                running = status
                events.append(Event(tick, status, self._channel_data(status)))
            else:
                raise ValueError("a track has data before its first message")
        return Track(events, tick)

    def _is_over(self) -> bool:
        if self.at == self._end:
            return _is_boundary(self._data, self.at)
        return self.at == len(self._data) > self._end

    def _take(self, count: int) -> bytes:
        start, self.at = self.at, self.at + count
        if self.at > self._limit:
            raise ValueError("a track ends within a message")
        return self._data[start : self.at]

    def _number(self) -> int:
        """Read a variable-length number of one to four bytes, seven bits each."""
        number = 0
        for _ in range(4):
            byte = self._take(1)[0]
            number = number << 7 | byte & 0x7F
            if byte < 0x80:
                return number
        raise ValueError("a time or a length has more than four bytes")

    def _channel_data(self, status: int) -> bytes:
        data = self._take(1 if 0xC0 <= status < 0xE0 else 2)
        if max(data) > 127:
            self.malformed += 1
            data = bytes(min(byte, 127) for byte in data)
        return data
