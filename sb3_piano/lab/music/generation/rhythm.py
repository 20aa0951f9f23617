"""Rhythms of a bar, drawn beat by beat."""

from __future__ import annotations

import numpy as np

from sb3_piano.lab.music.generation.frame import Frame

Rhythm = list[tuple[float, float]]
"""Start and length of each note, in quarter notes."""

_SIMPLE = (
    (0.0,),
    (0.0, 1 / 2),
    (0.0, 3 / 4),
    (1 / 2,),
    (0.0, 1 / 3, 2 / 3),
    (0.0, 1 / 2, 3 / 4),
    (0.0, 1 / 4, 1 / 2),
    (0.0, 1 / 4, 3 / 4),
    (0.0, 1 / 4, 1 / 2, 3 / 4),
)
_COMPOUND = (
    (0.0,),
    (0.0, 2 / 3),
    (0.0, 1 / 2, 2 / 3),
    (0.0, 1 / 3, 2 / 3),
    (1 / 3, 2 / 3),
    (0.0, 1 / 6, 1 / 3, 2 / 3),
    (0.0, 1 / 3, 1 / 2, 2 / 3, 5 / 6),
)
"""Onsets within a beat, in beats, for beats of 1 and of 1.5 quarter notes."""


def bar_rhythm(random: np.random.Generator, frame: Frame, density: float) -> Rhythm:
    """Draw the rhythm of a bar."""
    patterns = _SIMPLE if frame.beat == 1 else _COMPOUND
    odd = np.array([0.4 if pattern[0] or len(pattern) == 3 else 1.0 for pattern in patterns])
    counts = np.array([len(pattern) for pattern in patterns])
    starts: list[float] = []
    for beat in np.arange(0, frame.bar, frame.beat):
        if starts and random.random() < 0.45 / max(density, 0.6) - 0.2:
            continue  # the last note is held
        share = odd * np.exp(-((counts - density) ** 2))
        pattern = patterns[int(random.choice(len(patterns), p=share / share.sum()))]
        starts += [float(beat) + frame.beat * part for part in pattern]
    starts = starts or [0.0]
    ends = [*starts[1:], frame.bar]
    return [(start, end - start) for start, end in zip(starts, ends, strict=True)]


def phrase_rhythm(frame: Frame, density: float, salt: int = 0) -> Rhythm:
    """Return the rhythm of a phrase: bars from the piece's small set, and a calm last bar.

    Another ``salt`` gives another set.
    """
    habit = np.random.default_rng((frame.habits, salt))
    stock = [bar_rhythm(habit, frame, density) for _ in range(3)]
    calm = bar_rhythm(habit, frame, min(density / 2, 1.0))
    found: Rhythm = []
    for bar in range(frame.bars):
        last = bar == frame.bars - 1 and frame.bars > 1 and habit.random() < 0.6
        chosen = calm if last else stock[int(frame.random.integers(len(stock)))]
        found += [(bar * frame.bar + start, length) for start, length in chosen]
    return found


def even(frame: Frame, unit: float) -> Rhythm:
    """Return notes of equal length through a phrase; the last one may be shorter."""
    starts = np.arange(0, frame.length - 1e-6, unit).tolist()
    return [(start, min(unit, frame.length - start)) for start in starts]
