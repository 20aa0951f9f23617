"""Styles of piano writing: the parts of both hands, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from sb3_piano.lab.music.generation import accompaniment as low
from sb3_piano.lab.music.generation import melody as high
from sb3_piano.lab.music.generation.frame import Frame, Tone
from sb3_piano.lab.music.generation.rhythm import even, phrase_rhythm
from sb3_piano.music.hands import HANDS, Hand

Style = Callable[[Frame], list[Tone]]


def _sixteenths(frame: Frame, habit: np.random.Generator) -> float:
    """Draw the length of fast notes, in quarter notes."""
    if frame.beat == 1.5:
        return float(habit.choice((0.5, 0.25), p=(0.6, 0.4)))
    return float(habit.choice((0.5, 1 / 3, 0.25, 1 / 6), p=(0.35, 0.15, 0.45, 0.05)))


def _tune(frame: Frame, density: float | None = None) -> list[Tone]:
    """Draw a melody, perhaps with ornaments or added notes."""
    habit = frame.habit()
    density = float(habit.uniform(0.6, 2.2)) if density is None else density
    tones = high.melody(frame, "right", density=density, rests=float(habit.uniform(0, 0.2)))
    if habit.random() < 0.25:
        tones = high.ornament(frame, tones, 0.2)
    if habit.random() < 0.3:
        kind = str(habit.choice(("thirds", "sixths", "octaves", "chords")))
        tones = high.thicken(frame, tones, kind, float(habit.choice((0.15, 0.4, 1.0))))
    return tones


def _alberti(frame: Frame) -> list[Tone]:
    return _tune(frame) + low.alberti(frame, "left")


def _block(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    rhythm = low.chord_rhythm(frame, habit)
    return _tune(frame) + low.blocks(frame, "left", count=int(habit.integers(2, 4)), rhythm=rhythm)


def _wide(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    span, unit = int(habit.integers(14, 25)), _sixteenths(frame, habit)
    return _tune(frame, density=float(habit.uniform(0.5, 1.6))) + low.wave(
        frame, "left", span=span, unit=max(unit, 1 / 3)
    )


def _stride(frame: Frame) -> list[Tone]:
    return _tune(frame) + low.stride(frame, "left")


def _rag(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    kind = str(habit.choice(("octaves", "chords")))
    tones = high.thicken(frame, _syncopated(frame, 2.4), kind, float(habit.uniform(0.3, 1)))
    return tones + low.stride(frame, "left")


def _syncopated(frame: Frame, density: float) -> list[Tone]:
    """Draw a melody with some notes before the beat."""
    tones = high.melody(frame, "right", density=density)
    shift = 0.5 if density < 1.5 else 0.25
    starts = [max(tone.start - shift * (frame.random.random() < 0.4), 0.0) for tone in tones]
    ends = [*starts[1:], frame.length]
    return [
        replace(tone, start=start, length=min(tone.length + shift, end - start))
        for tone, start, end in zip(tones, starts, ends, strict=True)
        if end - start > 0.1  # else it coincides with the next one
    ]


def _syncopation(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    tones = _syncopated(frame, float(habit.uniform(0.8, 2.2)))
    if habit.random() < 0.5:
        tones = high.thicken(frame, tones, str(habit.choice(("thirds", "octaves", "chords"))), 0.5)
    makers = (low.alberti, low.stride)
    if habit.random() < 0.4:
        return tones + low.blocks(frame, "left", count=3, rhythm=low.offbeats(frame))
    return tones + makers[int(habit.integers(2))](frame, "left")


def _held(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    where, count = int(habit.integers(3)), int(habit.integers(1, 3))
    density = float(habit.uniform(0.8, 2.2))
    if where == 0:
        return low.held(frame, "right", density=density, count=count) + low.basses(
            frame, "left", octaves=bool(habit.random() < 0.5)
        )
    left = low.held(frame, "left", density=density, count=count)
    if where == 1:
        return left + _tune(frame, density=0.7)
    return left + low.held(frame, "right", density=density, count=count)


def _counterpoint(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    leader = high.melody(frame, "right", density=float(habit.uniform(1, 2.4)))
    if habit.random() < 0.35 and frame.bars > 1:  # the left hand imitates
        down = 12 * max(round((frame.register["right"] - frame.register["left"]) / 12), 1)
        return leader + [
            replace(tone, start=tone.start + frame.bar, pitch=tone.pitch - down, hand="left")
            for tone in leader
            if tone.start + frame.bar < frame.length - 1e-6
        ]
    return leader + high.melody(frame, "left", density=float(habit.uniform(0.6, 2.4)))


def _chorale(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit = float(habit.choice((1.0, 2.0), p=(0.8, 0.2))) if frame.beat == 1 else frame.beat
    return low.chorale(frame, unit, int(habit.integers(3, 5)))


def _octaves(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    kind = str(habit.choice(("octaves", "chords")))
    density = float(habit.uniform(0.6, 1.5))
    right = high.thicken(frame, high.melody(frame, "right", density=density), kind)
    makers: tuple[Callable[[], list[Tone]], ...] = (
        lambda: low.basses(frame, "left", octaves=True, unit=frame.beat),
        lambda: low.wave(frame, "left", span=16, unit=0.5),
        lambda: low.stride(frame, "left"),
        lambda: low.blocks(frame, "left", count=3, rhythm=low.chord_rhythm(frame, habit)),
    )
    return right + makers[int(habit.integers(len(makers)))]()


def _arpeggios(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit = max(_sixteenths(frame, habit), 0.25)
    kind = int(habit.integers(3))
    if kind == 0:
        return low.across(frame, unit, int(habit.integers(20, 40)))
    left = low.wave(frame, "left", span=int(habit.integers(12, 20)), unit=unit)
    if kind == 1:  # both hands alike
        return left + [replace(tone, pitch=tone.pitch + 12, hand="right") for tone in left]
    return low.wave(frame, "right", span=int(habit.integers(12, 25)), unit=unit) + low.basses(
        frame, "left", octaves=bool(habit.random() < 0.5)
    )


def _prelude(frame: Frame) -> list[Tone]:
    """Hold one or two low tones of each broken chord, and break the rest with the right hand."""
    habit = frame.habit()
    unit = 0.5 if frame.beat == 1.5 else 0.25
    size = round(min(frame.slot, 2.0 if frame.bar != 3 else frame.bar) / unit)
    span, kept = float(habit.uniform(16, 26)), int(habit.integers(1, 3))
    tones = []
    for index, (start, length) in enumerate(even(frame, unit)):
        at = index % size
        bass = frame.root(start, frame.register["left"])
        ladder = frame.chord(start, bass, bass + span)
        if at < kept:
            held = frame.slot if size * unit >= frame.slot else size * unit
            hold = max(min(held - at * unit, frame.length - start), unit)
            tones.append(Tone(start=start, length=hold, pitch=ladder[at], hand="left"))
        else:
            upper = ladder[kept:] or ladder[-1:]
            pitch = upper[(at - kept) % min(len(upper), 3)]
            tones.append(Tone(start=start, length=length, pitch=pitch, hand="right"))
    return tones


def _runs(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit = _sixteenths(frame, habit)
    chromatic, kind = bool(habit.random() < 0.25), int(habit.integers(5))
    hand: Hand = "left" if habit.random() < 0.35 else "right"
    lead = high.run(frame, hand, unit, chromatic=chromatic)
    other: Hand = "right" if hand == "left" else "left"
    if kind == 0:  # together, octaves apart
        down = 12 * int(habit.integers(1, 3)) * (1 if hand == "right" else -1)
        return lead + [replace(tone, pitch=tone.pitch - down, hand=other) for tone in lead]
    if kind == 1:  # one bar each
        mine = [tone for tone in lead if int(tone.start / frame.bar) % 2 == 0]
        answer = high.run(frame, other, unit, chromatic=chromatic)
        return mine + [tone for tone in answer if int(tone.start / frame.bar) % 2]
    if kind == 2:  # in thirds or tenths between the hands
        steps = int(habit.choice((2, 9))) * (1 if hand == "right" else -1)
        return lead + [
            replace(tone, pitch=frame.pitch(frame.step(tone.pitch) - steps), hand=other)
            for tone in lead
        ]
    if kind == 3 and not chromatic and unit >= 0.25:  # thirds in one hand
        lead = high.thicken(frame, high.run(frame, hand, max(unit, 0.5)), "thirds")
    rhythm = low.chord_rhythm(frame, habit)
    return lead + low.blocks(frame, other, count=int(habit.integers(1, 4)), rhythm=rhythm)


def _figuration(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit = frame.beat / int(habit.choice((3, 4, 4, 6)))
    right = high.figuration(frame, "right", unit)
    if habit.random() < 0.5:
        return right + low.basses(frame, "left", octaves=bool(habit.random() < 0.3))
    return right + low.wave(frame, "left", span=int(habit.integers(10, 20)), unit=frame.beat / 2)


def _polyrhythm(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    fast, slow = ((4, 3), (3, 2), (2, 3), (3, 4), (6, 4), (5, 3))[
        int(habit.choice(6, p=(0.3, 0.25, 0.2, 0.15, 0.05, 0.05)))
    ]
    beat = frame.beat if habit.random() < 0.6 else 2 * frame.beat
    span = int(habit.integers(10, 22))
    if habit.random() < 0.5:
        right = high.figuration(frame, "right", beat / fast)
    else:
        right = high.melody(frame, "right", density=1, rhythm=even(frame, beat / fast))
    return right + low.wave(frame, "left", span=span, unit=beat / slow)


def _repeated(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit = max(_sixteenths(frame, habit), 0.25)
    if habit.random() < 0.5:  # repeated chords below a melody, or a bass
        hand: Hand = "left" if habit.random() < 0.6 else "right"
        count = int(habit.integers(2, 4))
        chords = low.blocks(frame, hand, count=count, rhythm=even(frame, max(unit, 0.5)))
        if hand == "left":
            return _tune(frame) + chords
        return chords + low.basses(frame, "left", octaves=bool(habit.random() < 0.5))
    tones = high.repeat(high.melody(frame, "right", density=0.8), unit)
    return tones + low.blocks(frame, "left", count=2, rhythm=low.chord_rhythm(frame, habit))


def _oompah(frame: Frame) -> list[Tone]:
    """Hold a bass with the left hand, and strike off-beat chords in its reach or above."""
    habit = frame.habit()
    bass = low.basses(frame, "left", octaves=False)
    if habit.random() < 0.5:
        return bass + low.blocks(frame, "right", count=3, rhythm=low.offbeats(frame))
    chords = []
    for tone in low.blocks(frame, "left", count=2, rhythm=low.offbeats(frame)):
        held = frame.root(tone.start, frame.register["left"] - 6)
        if 2 < tone.pitch - held <= 12:
            chords.append(tone)
    return bass + chords + _tune(frame)


def _leaps(frame: Frame) -> list[Tone]:
    hand: Hand = "left" if frame.habit().random() < 0.75 else "right"
    if hand == "left":
        return _tune(frame, density=float(frame.habit().uniform(0.5, 1.5))) + low.leaps(frame, hand)
    return low.leaps(frame, hand) + low.alberti(frame, "left")


def _bells(frame: Frame) -> list[Tone]:
    """Strike a low bass, then hold a higher chord, under a calm melody."""
    habit = frame.habit()
    gap, count = float(habit.uniform(12, 22)), int(habit.integers(2, 5))
    low_at = frame.register["left"] - gap / 2
    unit = min(frame.slot, frame.bar)
    split = frame.beat if habit.random() < 0.8 else 2 * frame.beat
    split = split if split < unit else unit / 2
    tones = []
    for start, length in even(frame, unit):
        bass = frame.root(start, low_at)
        tones.append(Tone(start=start, length=split, pitch=bass, hand="left"))
        if length > split:
            tones += [
                Tone(start=start + split, length=length - split, pitch=pitch, hand="left")
                for pitch in frame.close(start, bass + gap, min(count, 3))
            ]
    return tones + _tune(frame, density=float(habit.uniform(0.5, 1.0)))


def _tenor(frame: Frame) -> list[Tone]:
    """Give the melody to the left hand, and broken or struck chords to the right one."""
    habit = frame.habit()
    tones = high.melody(frame, "left", density=float(habit.uniform(0.6, 1.8)))
    if habit.random() < 0.3:
        tones = high.thicken(frame, tones, "octaves", 0.5)
    if habit.random() < 0.5:
        return tones + low.alberti(frame, "right")
    rhythm = low.chord_rhythm(frame, habit)
    return tones + low.blocks(frame, "right", count=int(habit.integers(2, 4)), rhythm=rhythm)


def _toccata(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    return low.toccata(frame, max(_sixteenths(frame, habit), 0.25))


def _sequence(frame: Frame) -> list[Tone]:
    habit = frame.habit()
    unit, down = _sixteenths(frame, habit), 12 * int(habit.integers(1, 3))
    right = high.sequence(frame, "right", unit)
    if habit.random() < 0.7:
        return right + [replace(tone, pitch=tone.pitch - down, hand="left") for tone in right]
    return right + low.blocks(frame, "left", count=2, rhythm=low.chord_rhythm(frame, habit))


def _unison(frame: Frame) -> list[Tone]:
    """Play one melody with both hands, octaves apart, or a single hand alone."""
    habit = frame.habit()
    tones = high.melody(frame, "right", density=float(habit.uniform(0.7, 2.5)))
    if habit.random() < 0.25:
        hand: Hand = "left" if habit.random() < 0.5 else "right"
        down = 12 if hand == "left" else 0
        return [replace(tone, pitch=tone.pitch - down, hand=hand) for tone in tones]
    down = 12 * int(habit.integers(1, 4))
    return tones + [replace(tone, pitch=tone.pitch - down, hand="left") for tone in tones]


def _slow(frame: Frame) -> list[Tone]:
    """Hold slow thirds and sixths with both hands."""
    habit = frame.habit()
    tones = []
    for hand in HANDS:
        density = float(habit.uniform(0.25, 0.8))
        kind = str(habit.choice(("thirds", "sixths")))
        line = high.melody(
            frame, hand, density=density, rhythm=phrase_rhythm(frame, density, salt=len(hand))
        )
        tones += high.thicken(frame, line, kind, float(habit.choice((0.5, 1.0))))
    return tones


def _mixed(frame: Frame) -> list[Tone]:
    """Draw a part for each hand independently."""
    habit = frame.habit()
    unit = max(_sixteenths(frame, habit), 0.25)
    span, density = int(habit.integers(10, 22)), float(habit.uniform(0.6, 2.2))
    tones = []
    for hand in HANDS:
        parts: tuple[Callable[[Hand], list[Tone]], ...] = (
            lambda hand: high.melody(frame, hand, density=density),
            lambda hand: high.thicken(frame, high.melody(frame, hand, density=density), "chords"),
            lambda hand: high.run(frame, hand, unit),
            lambda hand: high.sequence(frame, hand, unit),
            lambda hand: high.figuration(frame, hand, unit),
            lambda hand: low.alberti(frame, hand),
            lambda hand: low.wave(frame, hand, span=span, unit=unit),
            lambda hand: low.stride(frame, hand),
            lambda hand: low.held(frame, hand, density=density),
            lambda hand: low.leaps(frame, hand),
        )
        tones += parts[int(habit.integers(len(parts)))](hand)
    return tones


STYLES: Mapping[str, Style] = MappingProxyType(
    {
        "alberti": _alberti,
        "arpeggios": _arpeggios,
        "bells": _bells,
        "block": _block,
        "chorale": _chorale,
        "counterpoint": _counterpoint,
        "figuration": _figuration,
        "held": _held,
        "leaps": _leaps,
        "mixed": _mixed,
        "octaves": _octaves,
        "oompah": _oompah,
        "polyrhythm": _polyrhythm,
        "prelude": _prelude,
        "rag": _rag,
        "repeated": _repeated,
        "runs": _runs,
        "sequence": _sequence,
        "slow": _slow,
        "stride": _stride,
        "syncopation": _syncopation,
        "tenor": _tenor,
        "toccata": _toccata,
        "unison": _unison,
        "wide": _wide,
    }
)
"""Functions that write a phrase, by name."""

PEDALLED = frozenset({"arpeggios", "bells", "figuration", "polyrhythm", "slow", "wide"})
"""Styles that use the sustain pedal."""

NEAR = frozenset({"toccata", "prelude"})
"""Styles with hands close to each other."""

LEAPING = frozenset({"bells", "leaps", "oompah", "rag", "stride", "syncopation"})
"""Styles that need space for the left hand."""
