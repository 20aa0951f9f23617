"""Frame of a phrase: key, meter, harmony and registers, shared by its parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sb3_piano.music.constants import MAX_PITCH, MIN_PITCH
from sb3_piano.music.hands import Hand

MAJOR, MINOR, HARMONIC, DORIAN = (
    (0, 2, 4, 5, 7, 9, 11),
    (0, 2, 3, 5, 7, 8, 10),
    (0, 2, 3, 5, 7, 8, 11),
    (0, 2, 3, 5, 7, 9, 10),
)
"""Scales, in semitones above the tonic."""

_NEXT: Mapping[int, Mapping[int, float]] = {
    0: {1: 2, 2: 1, 3: 4, 4: 4, 5: 3, 6: 0.5},
    1: {0: 1, 3: 1, 4: 5, 6: 1},
    2: {3: 2, 5: 4},
    3: {0: 3, 1: 2, 4: 4, 6: 0.5},
    4: {0: 6, 2: 0.5, 3: 1, 5: 2},
    5: {1: 3, 2: 1, 3: 3, 4: 2},
    6: {0: 5, 2: 1, 5: 1},
}
"""Weights of the chord after each chord, by scale degree from 0, the tonic."""


@dataclass(frozen=True, kw_only=True)
class Tone:
    """A written note: start and length in quarter notes, and accent."""

    start: float
    """Quarter notes from the beginning of the phrase."""
    length: float
    pitch: int
    hand: Hand
    accent: float = 0.0
    """Added to the velocity."""


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Settings shared by the parts of a phrase."""

    random: np.random.Generator
    """Random generator for choices that differ between phrases."""
    habits: int
    """Seed of choices that are constant in the piece, such as an accompaniment's figure."""
    tonic: int
    """0 (C) to 11."""
    scale: tuple[int, ...]
    bar: float
    """Length of a bar, in quarter notes."""
    beat: float
    """Length of a beat, in quarter notes: 1, or 1.5 in 6/8."""
    bars: int
    chords: tuple[tuple[int, int], ...]
    """Root (scale degree from 0) and number of tones of each chord, all equally long."""
    register: Mapping[Hand, float]
    """Pitch around which each hand plays."""

    @property
    def length(self) -> float:
        """Length of the phrase, in quarter notes."""
        return self.bars * self.bar

    @property
    def slot(self) -> float:
        """Length of a chord, in quarter notes."""
        return self.length / len(self.chords)

    def habit(self) -> np.random.Generator:
        """Return a generator with the same draws for every phrase of the piece."""
        return np.random.default_rng(self.habits)

    def pitch(self, step: int) -> int:
        """Return the MIDI pitch of a step of the scale; step 0 is the tonic of octave -1."""
        octave, degree = divmod(step, len(self.scale))
        return 12 * octave + self.tonic + self.scale[degree]

    def step(self, pitch: float) -> int:
        """Return the step of the scale that is nearest to a pitch."""
        guess = round((pitch - self.tonic) * len(self.scale) / 12)
        return min(range(guess - 2, guess + 3), key=lambda step: abs(self.pitch(step) - pitch))

    def degrees(self, time: float) -> tuple[int, ...]:
        """Return the scale degrees of the chord at a time, the root first."""
        index = min(int(time / self.slot + 1e-6), len(self.chords) - 1)
        root, size = self.chords[index]
        return tuple((root + 2 * third) % len(self.scale) for third in range(size))

    def chord(self, time: float, low: float, high: float) -> list[int]:
        """Return the pitches of the chord at a time, from `low` to `high`, ascending."""
        degrees = self.degrees(time)
        steps = range(self.step(low) - 1, self.step(high) + 2)
        pitches = [self.pitch(step) for step in steps if step % len(self.scale) in degrees]
        return [pitch for pitch in pitches if low <= pitch <= high]

    def root(self, time: float, near: float) -> int:
        """Return the root of the chord at a time that is nearest to a pitch."""
        degree = self.degrees(time)[0]
        pitch = self.tonic + self.scale[degree]
        return pitch + 12 * round((near - pitch) / 12)

    def close(self, time: float, centre: float, count: int) -> list[int]:
        """Return neighbouring tones of the chord at a time around a pitch, ascending."""
        tones = self.chord(time, centre - 14, centre + 14)
        starts = range(max(len(tones) - count + 1, 1))
        best = min(starts, key=lambda at: abs(float(np.mean(tones[at : at + count])) - centre))
        return tones[best : best + count]


def progression(
    random: np.random.Generator, count: int, seventh: float, start: int
) -> tuple[tuple[int, int], ...]:
    """Draw chords, a share with a seventh: root and number of tones of each."""
    roots = [start]
    while len(roots) < count:
        following = _NEXT[roots[-1]]
        roots.append(int(pick(random, following)))
    return tuple((root, 4 if random.random() < seventh else 3) for root in roots)


def pick(random: np.random.Generator, weights: Mapping[int, float]) -> int:
    """Draw a key of a mapping by weight."""
    share = np.array(list(weights.values()), dtype=float)
    return list(weights)[int(random.choice(len(share), p=share / share.sum()))]


def on_keyboard(pitch: int) -> int:
    """Transpose a pitch by octaves onto the keyboard."""
    while pitch < MIN_PITCH:
        pitch += 12
    while pitch > MAX_PITCH:
        pitch -= 12
    return pitch
