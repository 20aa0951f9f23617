"""Accompaniments: broken, struck and held chords, leaping basses, voices over a bass.

Lengths of notes (``unit``) are in quarter notes, spans in semitones, densities in notes a beat.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from sb3_piano.lab.music.generation.frame import Frame, Tone
from sb3_piano.lab.music.generation.melody import melody
from sb3_piano.lab.music.generation.rhythm import Rhythm, even, phrase_rhythm
from sb3_piano.music.hands import Hand

_TURNS = {
    3: ((0, 1, 2), (2, 1, 0), (0, 2, 1), (1, 0, 2)),
    4: ((0, 2, 1, 2), (0, 1, 2, 1), (2, 1, 0, 1), (0, 2, 0, 2), (1, 2, 0, 2)),
}
"""Orders of the three tones of a broken chord, in groups of three and four notes."""


_VOICE_REACH = 10
"""Reach of a voice from a held key of the same hand, semitones."""


def strike(rhythm: Rhythm, pitches: Callable[[float], Sequence[int]], hand: Hand) -> list[Tone]:
    """Return tones struck together at each onset of a rhythm."""
    return [
        Tone(start=start, length=length, pitch=pitch, hand=hand)
        for start, length in rhythm
        for pitch in pitches(start)
    ]


def alberti(frame: Frame, hand: Hand) -> list[Tone]:
    """Break each chord in close position by a pattern of three or four notes."""
    habit = frame.habit()
    turn = _TURNS[3 if frame.bar == 3 else 4]
    order = turn[int(habit.integers(len(turn)))]
    unit = 0.5 if frame.beat == 1.5 else float(habit.choice((0.5, 0.25), p=(0.7, 0.3)))
    count = itertools.count()
    rhythm = even(frame, unit)

    def pitches(start: float) -> list[int]:
        tones = frame.close(start, frame.register[hand], 3)
        return [tones[order[next(count) % len(order)] % len(tones)]]

    return strike(rhythm, pitches, hand)


def wave(frame: Frame, hand: Hand, *, span: int, unit: float) -> list[Tone]:
    """Break each chord widely, from its root up and perhaps down again."""
    habit = frame.habit()
    per_turn = max(round(min(frame.slot, frame.bar) / unit), 1)
    skip, back = int(habit.integers(1, 3)), bool(habit.random() < 0.6)
    tones = []
    for index, (start, length) in enumerate(even(frame, unit)):
        bass = frame.root(start, frame.register[hand] - span / 2)
        ladder = frame.chord(start, bass, bass + span)
        if skip == 2 and len(ladder) > 3:  # open position: the third goes up
            ladder.pop(1)
        at = index % per_turn
        top = len(ladder) - 1
        at = top - abs(at % (2 * top) - top) if back and top else at % len(ladder)
        accent = 6.0 if at == 0 else 0.0
        tones.append(Tone(start=start, length=length, pitch=ladder[at], hand=hand, accent=accent))
    return tones


def blocks(frame: Frame, hand: Hand, *, count: int, rhythm: Rhythm) -> list[Tone]:
    """Strike chords in close position."""
    return strike(rhythm, lambda t: frame.close(t, frame.register[hand], count), hand)


def offbeats(frame: Frame) -> Rhythm:
    """Return the rhythm of off-beat chords."""
    half = frame.beat / 2 if frame.beat == 1 else 0.5
    return [(start + half, frame.beat - half) for start, _ in even(frame, frame.beat)]


def basses(frame: Frame, hand: Hand, *, octaves: bool, unit: float | None = None) -> list[Tone]:
    """Hold roots, or roots in octaves."""

    def pitches(start: float) -> list[int]:
        root = frame.root(start, frame.register[hand] - 6)
        return [root, root + 12] if octaves else [root]

    return strike(even(frame, unit or frame.slot), pitches, hand)


def stride(frame: Frame, hand: Hand) -> list[Tone]:
    """Alternate a low bass note, or octave, with higher chords (stride)."""
    habit = frame.habit()
    octave = bool(habit.random() < 0.4)
    count = int(habit.integers(2, 4))
    gap = float(habit.uniform(10, 24))
    unit = 0.5 if frame.beat == 1.5 or (frame.bar == 2 and habit.random() < 0.7) else 1.0
    group = 3 if frame.bar == 3 else int(habit.choice((2, 4), p=(0.8, 0.2)))
    hold = bool(habit.random() < 0.3)
    tones = []
    for index, (start, length) in enumerate(even(frame, unit)):
        at = index % group
        low = frame.register[hand] - gap / 2
        if at == 0:
            bass = frame.root(start, low)
            if index // group % 2 and not octave and habit.random() < 0.6:
                bass = frame.chord(start, bass - 7, bass + 9)[0]  # the fifth or the third below
            struck = [bass, bass - 12] if octave and bass >= 36 else [bass]
        else:
            struck = frame.close(start, low + gap, count)
            if hold and at > 1:
                continue
            length = (group - 1) * unit if hold else length
        accent = 6.0 if at == 0 else -4.0
        tones += [
            Tone(start=start, length=length, pitch=pitch, hand=hand, accent=accent)
            for pitch in struck
        ]
    return tones


def held(frame: Frame, hand: Hand, *, density: float, count: int = 1) -> list[Tone]:
    """Hold the outer tones of each chord while a voice moves in the same hand."""
    sign = 1 if hand == "left" else -1
    bottom = frame.register[hand] - sign * 6

    def pitches(start: float) -> list[int]:
        return frame.close(start, bottom, count)

    found = strike(even(frame, frame.slot), pitches, hand)
    rhythm = phrase_rhythm(frame, density, salt=7)
    middle = bottom + sign * (4 + 2 * count)
    voice = melody(frame, hand, density=density, rhythm=rhythm, centre=middle, width=3, rests=0.0)
    # The little finger's side holds, the thumb's side moves within reach of it.
    for tone in voice:
        outer = pitches(tone.start)
        edge, far = (outer[-1], outer[0]) if sign > 0 else (outer[0], outer[-1])
        if sign * (tone.pitch - edge) > 0 and abs(tone.pitch - far) <= _VOICE_REACH:
            found.append(tone)
    return found


def leaps(frame: Frame, hand: Hand) -> list[Tone]:
    """Strike notes in leaps of one or two octaves."""
    habit = frame.habit()
    unit = float(habit.choice((0.5, 1.0, 2.0), p=(0.3, 0.5, 0.2)))
    gap, count = float(habit.uniform(9, 26)), int(habit.integers(1, 4))

    def pitches(start: float) -> list[int]:
        high = round(start / unit) % 2 == 1
        centre = frame.register[hand] + (gap if high else -gap) / 2 + frame.random.normal(0, 3)
        return frame.close(start, centre, count if high == (hand == "left") else 1)

    return strike(even(frame, unit), pitches, hand)


def chorale(frame: Frame, unit: float, voices: int) -> list[Tone]:
    """Set three or four voices in chords, two of them for each hand, with some passing notes."""
    random = frame.random
    soprano = melody(frame, "right", density=1.0, rhythm=even(frame, unit), rests=0.0)
    tones = []
    tenor_last = frame.register["left"] + 5
    for tone in soprano:
        start = tone.start
        top = min(frame.chord(start, tone.pitch - 4, tone.pitch + 4), key=_near(tone.pitch))
        alto = frame.chord(start, top - 10, top - 2)[-int(random.integers(1, 3)) :][0]
        bass = frame.root(start, frame.register["left"] - 4)
        tenor = min(frame.chord(start, bass + 3, bass + 12), key=_near(tenor_last))
        tenor_last = tenor
        right, left = (top, alto), (bass, tenor) if voices == 4 else (bass,)
        passing = random.random() < 0.2
        for pitch in (*right, *left):
            hand: Hand = "right" if pitch in right else "left"
            length = unit / 2 if passing and pitch == top else unit
            tones.append(Tone(start=start, length=length, pitch=pitch, hand=hand))
        if passing:
            after = frame.pitch(frame.step(top) + int(random.choice((-1, 1))))
            tones.append(Tone(start=start + unit / 2, length=unit / 2, pitch=after, hand="right"))
    return tones


def _near(pitch: float) -> Callable[[int], float]:
    return lambda other: abs(other - pitch)


def across(frame: Frame, unit: float, span: int) -> list[Tone]:
    """Break each chord from the low to the high register, through both hands."""
    habit = frame.habit()
    centre = (frame.register["left"] + frame.register["right"]) / 2
    size = int(habit.choice((6, 8, 12, 16)))
    back = bool(habit.random() < 0.5)
    tones = []
    for index, (start, length) in enumerate(even(frame, unit)):
        bass = frame.root(start, centre - span / 2)
        ladder = frame.chord(start, bass, bass + span)
        at, top = index % size, len(ladder) - 1
        at = top - abs(at % (2 * top) - top) if back else at % (top + 1)
        hand: Hand = "left" if at <= top / 2 else "right"
        tones.append(Tone(start=start, length=length, pitch=ladder[at], hand=hand))
    return tones


def toccata(frame: Frame, unit: float) -> list[Tone]:
    """Alternate close hands on single notes or small chords."""
    habit = frame.habit()
    centre = (frame.register["left"] + frame.register["right"]) / 2
    counts = {"left": int(habit.integers(1, 3)), "right": int(habit.integers(1, 4))}
    turn = [hand for hand in ("left", "right") for _ in range(int(habit.choice((1, 1, 2))))]
    apart = float(habit.uniform(4, 10))
    tones: list[Tone] = []
    for index, (start, length) in enumerate(even(frame, unit)):
        hand: Hand = "left" if turn[index % len(turn)] == "left" else "right"
        middle = centre + (apart if hand == "right" else -apart) + frame.random.normal(0, 2)
        tones += [
            Tone(start=start, length=length, pitch=pitch, hand=hand)
            for pitch in frame.close(start, middle, counts[hand])
        ]
    return tones


def chord_rhythm(frame: Frame, habit: np.random.Generator) -> Rhythm:
    """Draw the rhythm of chords: with the harmony, on beats, on half beats, or off the beat."""
    kind = int(habit.choice(5, p=(0.4, 0.2, 0.08, 0.14, 0.18)))
    if kind == 3:
        return offbeats(frame)
    if kind == 4:
        return phrase_rhythm(frame, 0.7, salt=3)
    return even(frame, (frame.slot, frame.beat, 0.5)[kind])
