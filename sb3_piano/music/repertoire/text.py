"""Files of the repertoire: a piece as text, with fingers.

A file begins with lines of ``key: value`` (see :class:`Header`), then come the bars::

    title: Für Elise (beginning)
    meter: 3/8
    unit: 1/16
    ...
    bar 0 length=2
    R: E5/5 D#5/4
    bar 1
    R: E5/5 D#5/4 E5/5 B4/1 D5/3 C5/2
    bar 2
    R: A4/1*2 - C4/1 E4/2 A4/5
    L: A2/5 E3/2 A3/1 -*3
    P: 0-3

``bar`` and a name begin a bar, as long as the meter says or, in units, ``length=``; ``tempo=`` is
the tempo from there on; ``bar 9 = 1`` plays bar 1 again. ``R:`` and ``L:`` are the hands; several
lines of one hand in a bar are voices that start together. ``P:`` says from when to when the pedal
is down, in units of the bar.

A note is ``F5/4``, its pitch and its finger, 1 (thumb) to 5 (little); a chord ``G3+Eb4/52``, a
finger for each note; a rest ``-``. Then, maybe, ``'`` for a dot (let go after half its length),
``*3``, ``*0.5`` or ``*2/3`` for the length in units, and ``~`` if it is tied to the next note of
its voice, whose fingers then mean nothing.

An indented line continues the one above. A ``#`` at the beginning of a line or after a space
begins a comment.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import takewhile
from pathlib import Path

from sb3_piano.exceptions import ScoreError
from sb3_piano.music.note import Note, Pedal, located_note
from sb3_piano.music.repertoire.bars import BAR_WORD, Bar, Event, Voice, parse_bars
from sb3_piano.music.repertoire.header import Header, parse_header
from sb3_piano.music.score import Score
from sb3_piano.music.text_file import read_text

_COMMENT = re.compile(r"(^|\s)#.*")
_SECONDS_PER_WHOLE = 240
"""Length of a whole note at one quarter note a minute, s."""

_HELD = Fraction(1, 2)
"""The part of its length for which a note with a dot is held, and any other note at least."""


def read_header(path: str | os.PathLike[str]) -> Header:
    """Read what a file says about its piece before the first bar.

    Raises:
        ScoreError: If there is no such file, or its header is malformed.
    """
    path = Path(path)
    return _header(_lines(read_text(path, "file of music as text")), path)


def read_notes(path: str | os.PathLike[str], title: str | None = None) -> Score:
    """Read a file of the repertoire, or one written like them.

    All bars have their lines, but for a first one that is shorter than the meter (an upbeat). A
    hand lets go of its notes earlier by its ``release``, but holds them for at least half of
    their length.

    Args:
        path: The file.
        title: Title of the score; by default the file's name without the suffix.

    Raises:
        ScoreError: If there is no such file, or something in it is malformed.
    """
    path = Path(path)
    lines = list(_lines(read_text(path, "file of music as text")))
    header = _header(lines, path)
    first = next((number for number, line in enumerate(lines) if _begins_bar(line)), len(lines))
    playing = _Playing(header=header, file=path.name, tempo=header.tempo)
    for bar in parse_bars(lines[first:], header.bar_length, path.name):
        playing.play(bar)
    playing.check_ties({}, f"The end of {path.name!r}")
    return Score(
        notes=playing.notes,
        pedals=playing.pedals,
        title=path.stem if title is None else title,
        bars=[float(line) for line in playing.lines],
    )


@dataclass(frozen=True)
class _Tie:
    """What is held by a voice when its next event begins: since when, and which event began it."""

    onset: Fraction
    event: Event


@dataclass(kw_only=True)
class _Playing:
    """Bars become notes, one bar after the other; times are exact, in s from the beginning."""

    header: Header
    file: str
    tempo: Fraction
    now: Fraction = Fraction(0)
    notes: list[Note] = field(default_factory=list)
    pedals: list[Pedal] = field(default_factory=list)
    lines: list[Fraction] = field(default_factory=list)
    ties: dict[Voice, _Tie] = field(default_factory=dict)

    def play(self, bar: Bar) -> None:
        """Add the notes of the next bar."""
        self.tempo = self.tempo if bar.tempo is None else bar.tempo
        unit = self.header.unit * _SECONDS_PER_WHOLE / self.tempo
        upbeat = self.now == 0 and bar.length < self.header.bar_length
        if not upbeat:
            self.lines.append(self.now)
        where = f"Bar {bar.name} of {self.file!r}"
        self.check_ties(bar.voices, where)
        for voice, events in bar.voices.items():
            start = self.now
            for event in events:
                end = start + event.length * unit
                self._play_event(voice, event, start, end, f"{where}, {voice[0]} hand")
                start = end
        self.pedals += [
            Pedal(onset=float(self.now + down * unit), offset=float(self.now + up * unit))
            for down, up in bar.pedals
        ]
        self.now += bar.length * unit

    def check_ties(self, voices: Iterable[Voice], where: str) -> None:
        """Refuse a tie whose voice does not go on."""
        for (hand, number), tie in self.ties.items():
            if (hand, number) not in voices:
                raise ScoreError(
                    f"{where}, {hand} hand, line {number + 1}: nothing follows the tie of "
                    f"{tie.event.text!r}: expected the same pitches."
                )

    def _play_event(
        self, voice: Voice, event: Event, start: Fraction, end: Fraction, where: str
    ) -> None:
        tie = self.ties.pop(voice, None)
        if tie is None:
            tie = _Tie(start, event)
        elif event.pitches != tie.event.pitches or event.dotted:
            raise ScoreError(
                f"{where}: {event.text!r} follows the tie of {tie.event.text!r}: expected the "
                "same pitches, without a dot."
            )
        if event.tied:
            self.ties[voice] = tie
        else:
            self.notes += self._notes(voice, tie, end, f"{where}, {event.text!r}")

    def _notes(self, voice: Voice, tie: _Tie, end: Fraction, where: str) -> Iterator[Note]:
        hand, _ = voice
        length = end - tie.onset
        held = length * _HELD
        if not tie.event.dotted:
            held = max(held, length - self.header.release[hand])
        for pitch, finger in zip(tie.event.pitches, tie.event.fingers, strict=True):
            yield located_note(
                where,
                onset=float(tie.onset),
                offset=float(tie.onset + held),
                pitch=pitch,
                velocity=self.header.velocity[hand],
                finger=finger,
            )


def _header(lines: Iterable[str], path: Path) -> Header:
    return parse_header(takewhile(lambda line: not _begins_bar(line), lines), path.name)


def _begins_bar(line: str) -> bool:
    return line.split()[0] == BAR_WORD


def _lines(text: str) -> Iterator[str]:
    """Yield the lines that mean something, without comments, each with those that continue it."""
    whole = ""
    for line in text.splitlines():
        line = _COMMENT.sub("", line).rstrip()
        if line and line[0].isspace() and whole:
            whole = f"{whole} {line.strip()}"
        elif line:
            if whole:
                yield whole
            whole = line.strip()
    if whole:
        yield whole
