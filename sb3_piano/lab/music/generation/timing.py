"""From tones in quarter notes to notes in seconds: tempo, touch, and what hands can hold."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sb3_piano.lab.music.generation.frame import Tone, on_keyboard
from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.hands import HANDS, Hand
from sb3_piano.music.note import Note

_SHORTEST = 0.06
"""Shortest note, s."""

_GAP = 0.02
"""Least time for which a key is up before it is struck again, s."""

_REACH = 13
"""Semitones that a hand holds at most between its outer keys."""

_OVERLAP = 0.08
"""Longest time for which notes of a hand overlap by its touch alone, s."""

_LEGATO = 4
"""Semitones from which on such notes do not overlap: the hand moves on."""

_LEAP = 7
"""Farther than so many semitones a hand lifts before it goes on; beside chords it always does."""

_LIFT = 0.05
"""For how long, s."""

_TOGETHER = 0.03
"""Longest time between notes that are struck together, s."""

_FASTEST = 0.085
"""Least time between strikes of a hand, s: the tempo is chosen so that most keep to it."""

_LEAP_PACE = 0.017
"""Least time for each semitone that a hand leaps by, s."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """When what is written is played."""

    quarter: float
    """Length of a quarter note, s."""
    rubato: float
    """How far the tempo swings, as a share of it; once in eight quarter notes."""
    phase: float
    """Where the swing begins, rad."""

    def seconds(self, time: float) -> float:
        """Return when a time in quarter notes is, in s."""
        pace = 2 * np.pi / 8
        sway = np.sin(pace * time + self.phase) - np.sin(self.phase)
        return float(self.quarter * (time + self.rubato * sway / pace))


@dataclass(frozen=True, kw_only=True)
class Touch:
    """How a piece is performed."""

    lengths: Mapping[Hand, float]
    """Share of its written length for which each hand holds a note."""
    volumes: Mapping[Hand, float]
    """MIDI velocity of each hand."""
    jitter: float
    """Standard deviation of the onsets, s."""
    lifts: bool
    """Whether hands come up in time for chords and leaps; else notes end where the next begin."""


def draw_clock(random: np.random.Generator, tempo: float) -> Clock:
    """Draw the course of a tempo, in quarter notes a minute: most pieces keep to it."""
    rubato = float(random.uniform(0.03, 0.15)) if random.random() < 0.3 else 0.0
    return Clock(quarter=60 / tempo, rubato=rubato, phase=float(random.uniform(0, 2 * np.pi)))


def draw_touch(random: np.random.Generator) -> Touch:
    """Draw how a piece is performed."""
    kinds = (
        lambda: random.uniform(0.3, 0.6),
        lambda: random.uniform(0.7, 0.95),
        lambda: 1.0,
        lambda: random.uniform(1.02, 1.12),
    )
    first = int(random.choice(4, p=(0.08, 0.27, 0.5, 0.15)))
    second = int(random.choice(4, p=(0.12, 0.3, 0.45, 0.13))) if random.random() < 0.4 else first
    loud = float(random.uniform(55, 95))
    return Touch(
        lengths={"right": float(kinds[first]()), "left": float(kinds[second]())},
        volumes={"right": loud, "left": loud - float(random.uniform(-3, 18))},
        jitter=float(random.uniform(0.003, 0.012)) if random.random() < 0.3 else 0.0,
        lifts=bool(random.random() < 0.92),
    )


def fastest_tempo(tones: Iterable[Tone]) -> float:
    """Return the tempo, in quarter notes a minute, above which the hands would have to hurry."""
    slowest = 0.0
    for hand in HANDS:
        struck: dict[float, list[int]] = {}
        for tone in tones:
            if tone.hand == hand:
                struck.setdefault(round(tone.start, 4), []).append(tone.pitch)
        starts = sorted(struck)
        if len(starts) < 2:
            continue
        centres = np.array([np.mean(struck[start]) for start in starts])
        ways = np.abs(np.diff(centres))
        needed = np.where(ways > 7, np.maximum(ways * _LEAP_PACE, _FASTEST), _FASTEST)
        slowest = max(slowest, float(np.quantile(needed / np.diff(starts), 0.95)))
    return 60 / slowest if slowest else np.inf


def perform(
    tones: Sequence[Tone], clock: Clock, touch: Touch, random: np.random.Generator
) -> list[Note]:
    """Return the notes of tones."""
    late: dict[tuple[float, Hand], float] = {}
    notes = []
    for tone in sorted(tones, key=lambda tone: (tone.start, tone.pitch)):
        place = (round(tone.start, 4), tone.hand)
        shift = late.setdefault(place, float(np.clip(random.normal(0, 1), -2.5, 2.5)))
        own = touch.jitter * (shift + 0.3 * random.normal(0, 1)) if touch.jitter else 0.0
        onset = clock.seconds(tone.start) + own
        end = tone.start + tone.length * min(touch.lengths[tone.hand], 1.0)
        offset = clock.seconds(end) + own
        if touch.lengths[tone.hand] > 1:
            offset += min((touch.lengths[tone.hand] - 1) * tone.length * clock.quarter, 0.06)
        velocity = touch.volumes[tone.hand] + tone.accent + random.normal(0, 3)
        notes.append(
            Note(
                onset=max(onset, 0.0),
                offset=max(offset, max(onset, 0.0) + _SHORTEST),
                pitch=on_keyboard(tone.pitch),
                velocity=int(np.clip(velocity, 15, 125)),
                hand=tone.hand,
            )
        )
    return _holdable(notes, touch.lifts)


@dataclass
class _Sounding:
    """A note whose end may still come earlier."""

    note: Note
    offset: float
    in_chord: bool

    @property
    def onset(self) -> float:
        return self.note.onset

    def release(self, time: float) -> None:
        """Let go at a time, if the note has sounded long enough by then, else a little later."""
        self.offset = max(min(self.offset, time), self.onset + _SHORTEST)


def _in_chords(notes: Sequence[Note]) -> list[bool]:
    """Return whether each note, in order of onset, is struck together with others of its hand."""
    found = [False] * len(notes)
    last: dict[Hand | None, int] = {}
    for at, note in enumerate(notes):
        before = last.get(note.hand)
        if before is not None and note.onset - notes[before].onset < _TOGETHER:
            found[before] = found[at] = True
        last[note.hand] = at
    return found


def _holdable(notes: Sequence[Note], lifts: bool) -> list[Note]:
    """Let go of notes where another one needs their key, or the hand, and drop what is double."""
    found: list[_Sounding] = []
    held: list[_Sounding] = []
    notes = sorted(notes, key=lambda note: (note.onset, note.pitch))
    for note, in_chord in zip(notes, _in_chords(notes), strict=True):
        new = _Sounding(note, note.offset, in_chord)
        held = [one for one in held if one.offset > note.onset - _LIFT]
        same = [one for one in held if one.note.pitch == note.pitch]
        mine = [one for one in held if one.note.hand == note.hand]
        together = [one for one in mine if note.onset - one.onset < _TOGETHER]
        struck_now = any(note.onset - one.onset < _SHORTEST + _GAP for one in same)
        if struck_now or len(together) >= FINGERS_PER_HAND:
            continue
        for one in same:
            one.release(note.onset - _GAP)
        for one in mine:
            if one not in together:
                _make_way(one, new, lifts)
        mine = [one for one in mine if one.offset > note.onset]
        for one in mine[: max(len(mine) - FINGERS_PER_HAND + 1, 0)]:
            one.release(note.onset)
        held.append(new)
        found.append(new)
    return [replace(one.note, offset=one.offset) for one in found]


def _make_way(one: _Sounding, new: _Sounding, lifts: bool) -> None:
    """Let go of a note if its hand cannot hold it, or need not, when it strikes another one."""
    way = abs(one.note.pitch - new.note.pitch)
    by_touch = one.offset - new.onset < _OVERLAP
    beside_chord = one.in_chord or new.in_chord
    if way > (_LEGATO if by_touch else _REACH) or (by_touch and beside_chord):
        lift = _LIFT if lifts and (way > _LEAP or beside_chord) else 0.0
        one.release(new.onset - lift)
