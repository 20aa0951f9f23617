"""The score, and transforms that make new scores from it."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from typing import Any

from sb3_piano.exceptions import ScoreError, one_line
from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH, UNKNOWN_FINGER
from sb3_piano.music.note import Note, Pedal, located_note, merge_pedals
from sb3_piano.text import printable


@dataclass(frozen=True, init=False, repr=False)
class Score:
    """An immutable piece of music: notes in seconds, pitches and fingers.

    Attributes:
        notes: The notes, sorted by onset, then pitch.
        pedals: The presses of the sustain pedal, sorted, without overlaps.
        title: Title of the piece, for messages and file names.
        bars: Time at which each bar begins, in s, finite, at least 0 and strictly increasing;
            empty if unknown. A bar that is under way at 0 s has no line. Bar lines do not affect
            equality, since they change nothing about the notes.

    Raises:
        ScoreError: If there are no notes, an item of `notes` or `pedals` has another type, or a bar
            line is no time or not later than the one before.
    """

    notes: tuple[Note, ...]
    pedals: tuple[Pedal, ...]
    title: str
    bars: tuple[float, ...] = field(default=(), compare=False)

    def __init__(
        self,
        *,
        notes: Iterable[Note],
        pedals: Iterable[Pedal] = (),
        title: str = "",
        bars: Iterable[float] = (),
    ) -> None:
        """Sort the notes, and merge overlapping or touching presses of the pedal."""
        notes, pedals = tuple(notes), tuple(pedals)
        _check_types(notes, Note, title)
        _check_types(pedals, Pedal, title)
        if not notes:
            raise ScoreError(f"Score {title!r} has no notes: expected at least one.")
        # The dataclass is frozen; its fields are set once, here.
        object.__setattr__(self, "notes", tuple(sorted(notes, key=_order)))
        object.__setattr__(self, "pedals", merge_pedals(pedals))
        object.__setattr__(self, "title", printable(title))
        object.__setattr__(self, "bars", _checked_bars(bars, title))

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Score:
        """Make a score from its fields as given by ``dataclasses.asdict``.

        Raises:
            ScoreError: If they are not the fields of a score.
        """
        try:
            notes = [Note(**note) for note in fields["notes"]]
            pedals = [Pedal(**pedal) for pedal in fields.get("pedals", ())]
            return cls(**{**fields, "notes": notes, "pedals": pedals})
        except (TypeError, KeyError) as error:
            raise ScoreError(
                f"A score cannot be made of these fields ({one_line(error)}): expected notes, "
                "pedals, title and bars."
            ) from error

    def __repr__(self) -> str:
        notes = "1 note" if len(self.notes) == 1 else f"{len(self.notes)} notes"
        return f"Score({self.title!r}, {notes}, {self.duration:g} s)"

    @property
    def duration(self) -> float:
        """Latest offset of a note, in s."""
        return max(note.offset for note in self.notes)

    @property
    def has_fingering(self) -> bool:
        """Whether at least one note has a finger label."""
        return any(note.finger != UNKNOWN_FINGER for note in self.notes)

    @property
    def pitch_range(self) -> tuple[int, int]:
        """The lowest and the highest MIDI pitch."""
        pitches = [note.pitch for note in self.notes]
        return min(pitches), max(pitches)

    def transpose(self, semitones: int) -> Score:
        """Shift the piece up (or down, if negative) by `semitones`.

        Raises:
            ScoreError: If `semitones` is not a whole number or takes a note off the keyboard.
        """
        if not isinstance(semitones, Integral):
            raise ScoreError(
                f"Cannot transpose {self.title!r} by {semitones!r}: expected whole semitones."
            )
        shift = int(semitones)
        outside = [n for n in self.notes if not MIN_PITCH <= n.pitch + shift <= MAX_PITCH]
        if outside:
            first, (low, high) = outside[0], self.pitch_range
            raise ScoreError(
                f"Transposing {self.title!r} by {shift} semitones takes {len(outside)} of its "
                f"{len(self.notes)} notes off the keyboard, first note {self.notes.index(first)} "
                f"(pitch {first.pitch} to {first.pitch + shift}): expected {MIN_PITCH - low} to "
                f"{MAX_PITCH - high}."
            )
        return replace(
            self, notes=tuple(replace(note, pitch=note.pitch + shift) for note in self.notes)
        )

    def stretch(self, factor: float) -> Score:
        """Multiply all times by `factor`: 2.0 is half as fast.

        Raises:
            ScoreError: If `factor` is not finite and above 0, or leaves a note without length.
        """
        if not math.isfinite(factor) or factor <= 0:
            raise ScoreError(
                f"Cannot stretch {self.title!r} by {factor}: expected a finite factor above 0."
            )
        return self.warp(lambda time: time * factor, f"stretched by {factor}")

    def warp(self, times: Callable[[float], float], how: str = "warped") -> Score:
        """Map all times by an increasing function, s to s; bar lines before 0 s are dropped.

        Raises:
            ScoreError: If a note gets a time before 0 s, or no length; `how` names the function.
        """
        notes = [
            located_note(
                f"Note {index} of {self.title!r} {how}",
                onset=times(note.onset),
                offset=times(note.offset),
                pitch=note.pitch,
                velocity=note.velocity,
                finger=note.finger,
                hand=note.hand,
            )
            for index, note in enumerate(self.notes)
        ]
        return Score(
            notes=notes,
            pedals=[Pedal(onset=times(p.onset), offset=times(p.offset)) for p in self.pedals],
            title=self.title,
            bars=[line for line in map(times, self.bars) if line >= 0],
        )

    def trim_silence(self) -> Score:
        """Shift the piece so that its first note starts at 0 s.

        Presses of the pedal and bar lines shift too; the part before 0 s is cut off.
        """
        return self.excerpt(self.notes[0].onset, math.inf)

    def excerpt(self, start: float, end: float) -> Score:
        """Cut out the notes struck from `start` up to, not including, `end`.

        Notes and presses of the pedal that last beyond `end` are cut there. A note struck before
        `start` is left out; a pedal pressed before is kept from `start` on. Bar lines are kept
        from `start` up to, not including, `end`. `start` becomes 0 s.

        Args:
            start: Beginning, in s, finite and at least 0.
            end: End, in s, later than `start`; infinity for the end of the piece.

        Raises:
            ScoreError: If the times are out of range, or no note is struck between them.
        """
        # Written so that NaN is refused as well.
        if not (math.isfinite(start) and 0 <= start < end):
            raise ScoreError(
                f"Cannot cut {self.title!r} from {start} s to {end} s: expected 0 <= start < end."
            )
        notes = [
            replace(note, onset=note.onset - start, offset=min(note.offset, end) - start)
            for note in self.notes
            if start <= note.onset < end
        ]
        if not notes:
            raise ScoreError(
                f"No note of {self.title!r} is struck from {start} s to {end} s: its onsets lie "
                f"between {self.notes[0].onset} s and {self.notes[-1].onset} s."
            )
        pedals = [
            Pedal(onset=max(pedal.onset, start) - start, offset=min(pedal.offset, end) - start)
            for pedal in self.pedals
            if pedal.onset < end and pedal.offset > start
        ]
        bars = [line - start for line in self.bars if start <= line < end]
        return Score(notes=notes, pedals=pedals, title=self.title, bars=bars)


def _order(note: Note) -> tuple[float, int, float, int, str, int]:
    """Sort key: onset and pitch; the rest makes the order of simultaneous notes definite."""
    return note.onset, note.pitch, note.offset, note.finger, note.hand or "", note.velocity


def _check_types(items: tuple[object, ...], expected: type, title: str) -> None:
    for index, item in enumerate(items):
        if not isinstance(item, expected):
            raise ScoreError(
                f"{expected.__name__} {index} of {title!r} is a {type(item).__name__}: "
                f"expected a {expected.__name__}."
            )


def _checked_bars(bars: Iterable[object], title: str) -> tuple[float, ...]:
    lines: list[float] = []
    for index, line in enumerate(bars):
        if not isinstance(line, Real) or not math.isfinite(line) or line < 0:
            raise ScoreError(
                f"Bar line {index} of {title!r} is at {line!r}: expected seconds from 0."
            )
        if lines and line <= lines[-1]:
            raise ScoreError(
                f"Bar line {index} of {title!r} is at {line} s: expected it after bar line "
                f"{index - 1} at {lines[-1]} s."
            )
        lines.append(float(line))
    return tuple(lines)


def digest(score: Score) -> str:
    """Compute the SHA-256 of notes and pedals, with times to a microsecond.

    Title and bar lines do not count. The hashed text is JSON without spaces: a list of
    [onset, offset, pitch, velocity, finger] for each note and one of [onset, offset] for each
    pedal, times in whole microseconds.
    """
    notes = [
        [_microseconds(n.onset), _microseconds(n.offset), n.pitch, n.velocity, n.finger]
        for n in score.notes
    ]
    pedals = [[_microseconds(p.onset), _microseconds(p.offset)] for p in score.pedals]
    return hashlib.sha256(json.dumps([notes, pedals], separators=(",", ":")).encode()).hexdigest()


def _microseconds(seconds: float) -> int:
    return round(seconds * 1e6)
