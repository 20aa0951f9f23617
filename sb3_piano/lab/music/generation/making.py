"""Generate rule-based music for two hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sb3_piano.lab.music.generation.frame import (
    DORIAN,
    HARMONIC,
    MAJOR,
    MINOR,
    Frame,
    Tone,
    progression,
)
from sb3_piano.lab.music.generation.loudness import shaped
from sb3_piano.lab.music.generation.styles import LEAPING, NEAR, PEDALLED, STYLES
from sb3_piano.lab.music.generation.timing import (
    Clock,
    Touch,
    draw_clock,
    draw_touch,
    fastest_tempo,
    perform,
)
from sb3_piano.music.constants import PITCH_CLASS_IS_BLACK
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Pedal
from sb3_piano.music.score import Score
from sb3_piano.settings import Positive, checked, refuse_unknown

_METERS = ((4.0, 1.0), (3.0, 1.0), (2.0, 1.0), (3.0, 1.5))
"""Length of a bar and of a beat in quarter notes: 4/4, 3/4, 2/4, 6/8."""

_FORMS = ("AABA", "ABAB", "AABB", "ABAC", "ABCA")
_SLOWEST, _FASTEST = 50.0, 180.0
"""Tempo range, quarter notes per minute."""

_SILENT = 0.05
"""Share of phrases with a silent hand."""


def generate_score(
    random: np.random.Generator, duration: float, style: str | None = None, near: bool = False
) -> Score:
    """Generate a piano piece.

    Key, meter, tempo, harmony, registers, figures and touch are drawn. Then phrases are written,
    which return with variations. Most notes have a hand, none has a finger.

    Args:
        random: Random generator.
        duration: Length in s; later notes are cut off.
        style: One of `STYLES`; by default drawn.
        near: Let both hands play in registers at most an octave apart, where they obstruct each
            other.

    Raises:
        ConfigError: If the duration is not above 0, or there is no such style.
    """
    duration = checked("duration", duration, Positive)
    if style is not None:
        refuse_unknown([style], STYLES, "style")
    else:
        style = str(random.choice(list(STYLES)))
    plan = _Plan.drawn(random, style, near)
    tones: list[Tone] = []
    phrases: dict[str, list[Tone]] = {}
    tempo = float(np.exp(random.uniform(np.log(_SLOWEST), np.log(_FASTEST))))
    count = 0
    length = plan.frame.length
    while not tones or count * length < (duration * tempo / 60):
        letter = plan.form[count % len(plan.form)]
        written = plan.phrase(letter, phrases)
        if count == 0:
            tempo = min(tempo, fastest_tempo(written))
        shape = shaped(written, plan.frame, plan.touch.arch, plan.touch.voicing)
        tones += [replace(tone, start=tone.start + count * length) for tone in shape]
        count += 1
    clock = draw_clock(random, tempo)
    notes = perform(tones, clock, plan.touch, random)
    if random.random() < 0.2:  # like a file without hands
        notes = [replace(note, hand=None) for note in notes]
    score = Score(
        notes=notes,
        pedals=plan.pedals(clock, count * length),
        title=f"generated {style}",
    )
    start = score.notes[0].onset
    return score.excerpt(start, start + duration)


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """Properties of a piece shared by its phrases."""

    style: str
    form: str
    """A letter for each phrase: the same letter, the same music."""
    frame: Frame
    """Frame of the phrases; each phrase draws its own chords and registers."""
    per_bar: float
    """Chords per bar."""
    seventh: float
    touch: Touch
    pedalled: bool

    @classmethod
    def drawn(cls, random: np.random.Generator, style: str, near: bool) -> _Plan:
        """Draw a plan for a style."""
        scales = (MAJOR, HARMONIC, MINOR, DORIAN)
        scale = scales[int(random.choice(4, p=(0.55, 0.25, 0.15, 0.05)))]
        bar, beat = _METERS[int(random.choice(4, p=(0.45, 0.25, 0.15, 0.15)))]
        if style == "stride" and random.random() < 0.5:
            bar, beat = 3.0, 1.0
        two = bar in (2.0, 4.0)
        right = float(np.clip(random.normal(73, 6), 60, 92))
        apart = random.uniform(5, 14) if style in NEAR else random.uniform(12, 34)
        if style in LEAPING:
            apart = random.uniform(22, 36)
        elif random.random() < 0.08:
            apart = random.uniform(0, 12)
        highest = 66  # pitch of the left hand's register
        if near:
            apart, highest = random.uniform(5, 12), 80  # semitones, pitch
        form, tonic = str(random.choice(_FORMS)), _tonic(random, scale)
        bars = int(random.choice((2, 4), p=(0.6, 0.4)))
        per_bar = float(random.choice((1, 2 if two else 1, 0.5), p=(0.6, 0.3, 0.1)))
        seventh = float(random.choice((0.0, 0.15, 0.5)))
        frame = Frame(
            random=random,
            habits=int(random.integers(2**31)),
            tonic=tonic,
            scale=scale,
            bar=bar,
            beat=beat,
            bars=bars,
            chords=(),
            register={"right": right, "left": float(np.clip(right - apart, 43, highest))},
        )
        return cls(
            style=style,
            form=form,
            frame=frame,
            per_bar=per_bar,
            seventh=seventh,
            touch=draw_touch(random, frame.habit()),
            pedalled=bool(random.random() < (0.7 if style in PEDALLED else 0.15)),
        )

    def phrase(self, letter: str, written: dict[str, list[Tone]]) -> list[Tone]:
        """Write a phrase, or repeat a written one, perhaps varied."""
        frame, random = self.frame, self.frame.random
        if letter in written and random.random() < 0.75:
            return _varied(frame, written[letter])
        register = {hand: frame.register[hand] + float(random.normal(0, 2)) for hand in HANDS}
        start = 0 if letter == "A" else int(random.choice((0, 3, 4, 5)))
        count = max(round(frame.bars * self.per_bar), 1)
        chords = progression(random, count, self.seventh, start)
        tones = STYLES[self.style](replace(frame, chords=chords, register=register))
        silent = HANDS[int(random.integers(2))]
        others = [tone for tone in tones if tone.hand != silent]
        if others and written and random.random() < _SILENT:
            tones = others
        written[letter] = tones
        return tones

    def pedals(self, clock: Clock, length: float) -> list[Pedal]:
        """Return presses of the pedal, one for each chord."""
        if not self.pedalled:
            return []
        every = self.frame.bar / max(self.per_bar, 1)
        starts = np.arange(0, length, every)
        return [
            Pedal(onset=clock.seconds(start + 0.1), offset=clock.seconds(start + every - 0.1))
            for start in starts.tolist()
        ]


def _tonic(random: np.random.Generator, scale: tuple[int, ...]) -> int:
    """Draw a tonic; keys with few black keys have more weight."""
    black = [
        sum(PITCH_CLASS_IS_BLACK[(tonic + step) % 12] for step in scale) for tonic in range(12)
    ]
    weights = np.interp(black, (0, 6), (2.0, 0.8))
    return int(random.choice(12, p=weights / weights.sum()))


def _varied(frame: Frame, tones: Sequence[Tone]) -> list[Tone]:
    """Return a phrase unchanged, moved by an octave, or with a few other notes."""
    random = frame.random
    kind = random.random()
    if kind < 0.4:
        return list(tones)
    if kind < 0.55:
        shift = 12 if np.mean([tone.pitch for tone in tones]) < 63 else -12
        hand = HANDS[int(random.integers(2))]
        both = random.random() < 0.5
        return [
            replace(tone, pitch=tone.pitch + shift) if both or tone.hand == hand else tone
            for tone in tones
        ]
    moved = []
    for tone in tones:
        pitch = tone.pitch
        if random.random() < 0.1:
            pitch += int(random.choice((-2, -1, 1, 2)))
            pitch = pitch if (pitch - frame.tonic) % 12 in frame.scale else tone.pitch
        moved.append(replace(tone, pitch=pitch))
    return moved
