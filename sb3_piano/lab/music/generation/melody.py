"""Leading parts: melodies and their doublings; scale runs, sequences, figuration.

Lengths of notes (``unit``) are in quarter notes, densities in notes a beat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sb3_piano.lab.music.generation.frame import Frame, Tone, pick
from sb3_piano.lab.music.generation.rhythm import Rhythm, even, phrase_rhythm
from sb3_piano.music.hands import Hand

_MOVES = {0: 6, 1: 32, -1: 34, 2: 9, -2: 9, 3: 4, -3: 4, 4: 2, -4: 2, 5: 1, -5: 1, 7: 1, -7: 0.5}
"""Weights of a melody's intervals, in steps of the scale: mostly to a neighbour."""

_RANGE = 8
"""Default range of a melody around its middle, in steps of the scale."""


def melody(
    frame: Frame,
    hand: Hand,
    *,
    density: float,
    rhythm: Rhythm | None = None,
    centre: float | None = None,
    rests: float = 0.06,
    width: int = _RANGE,
) -> list[Tone]:
    """Draw a melody: a random walk on the scale, with chord tones on strong beats.

    It moves around a pitch, by default the hand's register, at most ``width`` steps of the scale
    away from it; ``rests`` is the share of omitted notes.
    """
    random = frame.random
    middle = frame.step(frame.register[hand] if centre is None else centre)
    step = _chord_step(frame, 0.0, middle + int(random.integers(-width // 3, width // 3 + 1)))
    tones: list[Tone] = []
    leapt = 0
    for start, length in rhythm or phrase_rhythm(frame, density):
        move = -int(np.sign(leapt)) if leapt else pick(random, _MOVES)
        if abs(step + move - middle) > width:
            move = -move
        leapt = move if abs(move) > 2 else 0
        step = int(np.clip(step + move, middle - width, middle + width))
        if abs(start / frame.beat % 1) < 1e-6 and random.random() < 0.35:
            step = _chord_step(frame, start, step)
        if tones and random.random() < rests:
            continue
        strong = 8.0 if start % frame.bar < 1e-6 else 0.0
        pitch = frame.pitch(step) + (random.random() < 0.02)
        tones.append(Tone(start=start, length=length, pitch=pitch, hand=hand, accent=strong))
    return tones


def _chord_step(frame: Frame, time: float, step: int) -> int:
    """Return the chord's step of the scale nearest to a given step."""
    degrees = frame.degrees(time)
    near = [at for at in range(step - 3, step + 4) if at % len(frame.scale) in degrees]
    return min(near, key=lambda at: (abs(at - step), at))


def ornament(frame: Frame, tones: Sequence[Tone], share: float) -> list[Tone]:
    """Return a melody with trills and grace notes on a share of its long notes."""
    found = []
    for tone in tones:
        above = frame.pitch(frame.step(tone.pitch) + 1)
        if tone.length < 0.75 or frame.random.random() > share:
            found.append(tone)
        elif frame.random.random() < 0.5:  # a grace note
            grace = replace(tone, length=0.125, pitch=above)
            found += [grace, replace(tone, start=tone.start + 0.125, length=tone.length - 0.125)]
        else:
            count = 2 * int(frame.random.integers(1, 4))
            unit = min(tone.length / (count + 1), 0.1875)
            found += [
                replace(tone, start=tone.start + at * unit, length=unit, pitch=pitch)
                for at, pitch in enumerate([tone.pitch, above] * (count // 2))
            ]
            shaken = count * unit
            found.append(replace(tone, start=tone.start + shaken, length=tone.length - shaken))
    return found


def thicken(frame: Frame, tones: Sequence[Tone], kind: str, share: float = 1.0) -> list[Tone]:
    """Add notes to a melody that the same hand strikes together with it.

    ``kind`` is "thirds", "sixths", "octaves" or "chords" (within an octave). ``share`` is the share
    of notes that get them; strong notes always do.
    """
    found = list(tones)
    side = -1 if not tones or tones[0].hand == "right" else 1
    for tone in tones:
        if not tone.accent and frame.random.random() > share:
            continue
        step, others = frame.step(tone.pitch), []
        if kind in ("thirds", "sixths"):
            others = [frame.pitch(step + side * (2 if kind == "thirds" else 5))]
        if kind in ("octaves", "chords"):
            others = [tone.pitch + 12 * side]
        if kind == "chords":
            # Farther from the little finger, no finger of the robot reaches next to the thumb.
            low, high = sorted((tone.pitch + 2 * side, tone.pitch + 7 * side))
            inner = frame.chord(tone.start, low, high)
            count = min(1 + int(frame.random.random() < 0.25), len(inner))
            others += sorted(frame.random.choice(inner, count, replace=False).tolist())
            if frame.random.random() < 0.4:
                others = others[1:] or others
        found += [replace(tone, pitch=pitch) for pitch in others]
    return found


def repeat(tones: Sequence[Tone], unit: float) -> list[Tone]:
    """Return each note repeated every `unit` quarter notes."""
    found = []
    for tone in tones:
        count = max(round(tone.length / unit), 1)
        size = tone.length / count
        found += [replace(tone, start=tone.start + at * size, length=size) for at in range(count)]
    return found


def run(frame: Frame, hand: Hand, unit: float, *, chromatic: bool = False) -> list[Tone]:
    """Draw a scale that runs up and down through some octaves."""
    random, centre = frame.random, frame.register[hand]
    span = int(random.integers(8, 25))
    step, way = 0, int(random.choice((-1, 1)))
    at = int(centre) if chromatic else frame.step(centre)
    size = span if chromatic else span * 7 // 12
    step = -way * size // 2
    tones = []
    for start, length in even(frame, unit):
        pitch = at + step if chromatic else frame.pitch(at + step)
        accent = 6.0 if start % frame.beat < 1e-6 else 0.0
        tones.append(Tone(start=start, length=length, pitch=pitch, hand=hand, accent=accent))
        if abs(step + way) > size / 2 or (accent and random.random() < 0.1):
            way = -int(np.sign(step)) if abs(step + way) > size / 2 and step else -way
        step += way
    return tones


def sequence(frame: Frame, hand: Hand, unit: float) -> list[Tone]:
    """Draw a five-finger pattern that moves by a step of the scale each time."""
    habit = frame.habit()
    size = int(habit.choice((4, 6, 8)))
    pattern = [0]
    while len(pattern) < size:
        more = int(habit.integers(0, 6))
        if more != pattern[-1]:
            pattern.append(more)
    base, way = frame.step(frame.register[hand]), int(habit.choice((-1, 1)))
    base -= way * int(habit.integers(2, 6))
    tones = []
    for index, (start, length) in enumerate(even(frame, unit)):
        turn, at = divmod(index, size)
        pitch = frame.pitch(base + way * turn + pattern[at])
        accent = 6.0 if at == 0 else 0.0
        tones.append(Tone(start=start, length=length, pitch=pitch, hand=hand, accent=accent))
    return tones


def figuration(frame: Frame, hand: Hand, unit: float) -> list[Tone]:
    """Draw fast figures: chord tones with neighbours and short scales between."""
    random, middle = frame.random, frame.step(frame.register[hand])
    step, way, chordal = middle, int(random.choice((-1, 1))), True
    tones = []
    for start, length in even(frame, unit):
        if start % frame.beat < 1e-6:
            chordal = bool(random.random() < 0.55)
            way = -way if random.random() < 0.35 else way
            step = _chord_step(frame, start, step)
        if abs(step - middle) > _RANGE:
            way = -int(np.sign(step - middle))
        tones.append(Tone(start=start, length=length, pitch=frame.pitch(step), hand=hand))
        step += way
        while chordal and step % len(frame.scale) not in frame.degrees(start):
            step += way
        if random.random() < 0.12:
            way = -way
    return tones
