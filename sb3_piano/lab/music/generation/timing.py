"""Convert tones in quarter notes to notes in seconds: tempo, touch, limits of the hands."""

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
"""Least time between a key's release and its next strike, s."""

_REACH = 13
"""Largest span of a hand, semitones."""

_OVERLAP = 0.08
"""Longest overlap of a hand's notes by touch alone, s."""

_LEGATO = 4
"""Interval from which such notes do not overlap, as the hand moves, semitones."""

_LEAP = 7
"""Interval above which a hand lifts before it moves, semitones; next to chords it always lifts."""

_LIFT = 0.05
"""Duration of such a lift, s."""

_TOGETHER = 0.03
"""Longest time between onsets of notes struck together, s."""

_FASTEST = 0.085
"""Least time between strikes of a hand, s; the tempo keeps most strikes above it."""

_LEAP_PACE = 0.017
"""Least time per semitone of a leap, s."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Conversion of written time to seconds."""

    quarter: float
    """Length of a quarter note, s."""
    rubato: float
    """Amplitude of the tempo's swing, as a share of it; the period is eight quarter notes."""
    phase: float
    """Initial phase of the swing, rad."""

    def seconds(self, time: float) -> float:
        """Convert a time in quarter notes to s."""
        pace = 2 * np.pi / 8
        sway = np.sin(pace * time + self.phase) - np.sin(self.phase)
        return float(self.quarter * (time + self.rubato * sway / pace))


@dataclass(frozen=True, kw_only=True)
class Touch:
    """Touch of a performance."""

    lengths: Mapping[Hand, float]
    """Held share of a note's written length, by hand."""
    volume: float
    """MIDI velocity of the melody, on average."""
    arch: float
    """Velocities by which the middle of a phrase is louder than its ends."""
    voicing: float
    """Velocities by which the melody is louder than the tones below it."""
    jitter: float
    """Standard deviation of the onsets, s."""
    lifts: bool
    """Whether hands lift before chords and leaps; else notes end where the next ones begin."""


def draw_clock(random: np.random.Generator, tempo: float) -> Clock:
    """Draw a clock for a tempo in quarter notes per minute; most pieces have no rubato."""
    rubato = float(random.uniform(0.03, 0.15)) if random.random() < 0.3 else 0.0
    return Clock(quarter=60 / tempo, rubato=rubato, phase=float(random.uniform(0, 2 * np.pi)))


def draw_touch(random: np.random.Generator, habit: np.random.Generator) -> Touch:
    """Draw the touch of a performance; its phrases' shape is a habit."""
    kinds = (
        lambda: random.uniform(0.3, 0.6),
        lambda: random.uniform(0.7, 0.95),
        lambda: 1.0,
        lambda: random.uniform(1.02, 1.12),
    )
    first = int(random.choice(4, p=(0.08, 0.27, 0.5, 0.15)))
    second = int(random.choice(4, p=(0.12, 0.3, 0.45, 0.13))) if random.random() < 0.4 else first
    volume = float(random.uniform(55, 95))
    return Touch(
        lengths={"right": float(kinds[first]()), "left": float(kinds[second]())},
        volume=volume,
        voicing=float(random.uniform(10, 15)),
        arch=float(habit.uniform(6, 16)),
        jitter=float(random.uniform(0.003, 0.012)) if random.random() < 0.3 else 0.0,
        lifts=bool(random.random() < 0.92),
    )


def fastest_tempo(tones: Iterable[Tone]) -> float:
    """Return the fastest comfortable tempo of tones, in quarter notes per minute."""
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
    """Convert tones to notes, with the hands' limits."""
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
        velocity = touch.volume + tone.accent + random.normal(0, 3)
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
    """A sounding note that may be released early."""

    note: Note
    offset: float
    in_chord: bool

    @property
    def onset(self) -> float:
        return self.note.onset

    def release(self, time: float) -> None:
        """Release the note at a time, or at its shortest length if that is later."""
        self.offset = max(min(self.offset, time), self.onset + _SHORTEST)


def _in_chords(notes: Sequence[Note]) -> list[bool]:
    """Return for each note, by onset, whether it is struck with others of its hand."""
    found = [False] * len(notes)
    last: dict[Hand | None, int] = {}
    for at, note in enumerate(notes):
        before = last.get(note.hand)
        if before is not None and note.onset - notes[before].onset < _TOGETHER:
            found[before] = found[at] = True
        last[note.hand] = at
    return found


def _holdable(notes: Sequence[Note], lifts: bool) -> list[Note]:
    """Release notes whose key or hand another note needs, and drop duplicates."""
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
    """Release a note if its hand cannot or need not hold it while striking another one."""
    way = abs(one.note.pitch - new.note.pitch)
    by_touch = one.offset - new.onset < _OVERLAP
    beside_chord = one.in_chord or new.in_chord
    if way > (_LEGATO if by_touch else _REACH) or (by_touch and beside_chord):
        lift = _LIFT if lifts and (way > _LEAP or beside_chord) else 0.0
        one.release(new.onset - lift)
