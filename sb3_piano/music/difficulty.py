"""Compute features that make a score hard, and rank pieces by them.

A key counts as pressed from a note's onset to its offset; notes held by the pedal alone do not
count. Presses that overlap by less than 1 ms count as consecutive: times are rounded, and a melody
in legato has one note at a time.

The rank uses weighted z-scores of the features. The formula is from E. Farah, I. Lin and
G. Walrath, "Curriculum Strategies for Bimanual Dexterous Piano Playing in RoboPianist", section
5.1.1, over all ranked pieces:

    D = 0.25 z(average polyphony) + 0.15 z(maximum polyphony) + 0.20 z(onset density)
      + 0.10 z(action variance) + 0.10 z(hand motion) + 0.10 z(fingertip motion).

The weights sum to 0.90, not 1; they are kept, since only the order counts. The last three features
come from takes, which ``sb3-piano evaluate RUN --motion`` and ``play`` write. Without takes, D has
the terms of the score: the first three and 0.10 z(hand motion), where the motion of the hands'
centres along the keyboard replaces the joints' motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from sb3_piano.arrays import FloatArray
from sb3_piano.exceptions import ConfigError
from sb3_piano.music.fingering.ergonomic import struck_together
from sb3_piano.music.fingering.split import assign_hands
from sb3_piano.music.hands import HANDS
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

SAME_TIME = 1e-3
"""Shorter overlaps are ignored, in s."""


@dataclass(frozen=True, kw_only=True)
class Features:
    """Features of a score that make it hard.

    The names are those of the paper that :func:`~sb3_piano.music.difficulty.rank` follows.
    """

    notes: int
    """Number of notes."""
    duration: float
    """From the first onset to the last offset, in s."""
    average_polyphony: float
    """Number of keys pressed at once, as a mean over the duration; silence counts as no key."""
    maximum_polyphony: int
    """The most keys pressed at once."""
    onset_density: float
    """Notes per second of the duration."""
    hand_span: int
    """The widest interval that one hand holds, in semitones."""
    hand_motion: float
    """Distance that a hand's centre moves per second of the duration, in semitones, mean over both
    hands. The centre is midway between the lowest and highest key of a chord, and moves from one
    chord or single note to the next. A resting hand does not move."""
    pitch_range: tuple[int, int]
    """The lowest and the highest MIDI pitch."""


def features(score: Score) -> Features:
    """Compute the features of a score.

    The notes' own hands are used; if any is unknown, all are assigned as for fingering.
    """
    duration = score.duration - score.notes[0].onset
    is_handed = all(note.hand is not None for note in score.notes)
    handed = score if is_handed else assign_hands(score)
    hands = [[note for note in handed.notes if note.hand == hand] for hand in HANDS]
    travel = sum(_travel(notes) for notes in hands)
    return Features(
        notes=len(score.notes),
        duration=duration,
        average_polyphony=_pressed_time(score.notes) / duration,
        maximum_polyphony=max(len(pitches) for pitches in _held(score.notes)),
        onset_density=len(score.notes) / duration,
        hand_span=max(max(held) - min(held) for notes in hands for held in _held(notes)),
        hand_motion=travel / len(hands) / duration,
        pitch_range=score.pitch_range,
    )


def _pressed_time(notes: Iterable[Note]) -> float:
    """Sum the time for which keys are pressed over the keys, in s."""
    total = 0.0
    pressed_until: dict[int, float] = {}
    for note in notes:
        start = max(note.onset, pressed_until.get(note.pitch, 0.0))
        if note.offset > start:
            total += note.offset - start
            pressed_until[note.pitch] = note.offset
    return total


def _held(notes: Iterable[Note]) -> Iterator[list[int]]:
    """Yield the pitches held after each strike."""
    held: list[Note] = []
    for note in notes:
        held = [
            other
            for other in held
            if other.pitch != note.pitch
            and (other.offset > note.onset + SAME_TIME or other.onset == note.onset)
        ]
        held.append(note)
        yield [other.pitch for other in held]


def _travel(notes: Sequence[Note]) -> float:
    """Sum the distances that one hand's centre moves, in semitones."""
    chords = [[notes[index].pitch for index in chord] for chord in struck_together(notes)]
    centres = [(min(chord) + max(chord)) / 2 for chord in chords]
    return sum(abs(end - start) for start, end in itertools.pairwise(centres))


@dataclass(frozen=True, kw_only=True)
class MotionFeatures:
    """Amount of motion in a performance, per control step.

    Compare only performances with the same action space and control time step.
    """

    action_variance: float
    """Variance of each action component over the steps, as a mean over the components."""
    hand_motion: float
    """Absolute motion of a hand joint between two steps, as a mean over steps and joints; rad, and
    m for the two sliders."""
    fingertip_motion: float
    """Motion of a fingertip between two steps, as a mean over steps and the ten fingertips, in
    m."""


def mean_motion(several: Sequence[MotionFeatures]) -> MotionFeatures:
    """Average the features over several performances of one piece, at least one."""
    names = [field.name for field in fields(MotionFeatures)]
    means = {name: float(np.mean([getattr(one, name) for one in several])) for name in names}
    return MotionFeatures(**means)


_SCORE_WEIGHTS = {"average_polyphony": 0.25, "maximum_polyphony": 0.15, "onset_density": 0.20}
_MOTION_WEIGHTS = {"action_variance": 0.10, "hand_motion": 0.10, "fingertip_motion": 0.10}

_CONSTANT = 1e-9
"""A feature with less spread than this, relative to its size, is constant but for rounding."""


@dataclass(frozen=True, kw_only=True)
class Difficulty:
    """Difficulty of a piece relative to others."""

    score: float
    """D of the formula: 0 for the average piece, higher is harder."""
    rank: int
    """Place among the pieces, 1 for the easiest; equal scores share the lowest place."""
    percentile: float
    """Percentile rank, above 0 and up to 100: the place as a share of the number of pieces, in %.
    Equal scores share the mean place. (The paper's percentiles are multiples of 1/303, as with 303
    pieces.)"""


def rank(
    features: Mapping[str, Features], motion: Mapping[str, MotionFeatures] | None = None
) -> dict[str, Difficulty]:
    """Rank pieces by difficulty.

    A z-score is a difference from the pieces' mean in (population) standard deviations; a feature
    that is the same for all has 0. So each value depends on all ranked pieces, and values of
    different rankings are not comparable: record all pieces, or none. ``motion`` has the features
    of recorded performances; other pieces in it are ignored.

    Returns:
        The difficulty of each piece by its name, the easiest first, equal ones by name.

    Raises:
        ConfigError: If `motion` is given, but lacks a piece.
    """
    names = sorted(features)
    if not names:
        return {}
    terms = _terms(_SCORE_WEIGHTS, [features[name] for name in names])
    if motion is None:
        terms += _terms({"hand_motion": 0.10}, [features[name] for name in names])
    else:
        _check_recorded(names, motion)
        terms += _terms(_MOTION_WEIGHTS, [motion[name] for name in names])
    return _ranked(names, np.sum(terms, axis=0))


def _terms(weights: Mapping[str, float], pieces: Sequence[object]) -> list[FloatArray]:
    return [w * _z([getattr(piece, name) for piece in pieces]) for name, w in weights.items()]


def _z(values: Sequence[float]) -> FloatArray:
    array = np.array(values, dtype=np.float64)
    spread = float(array.std())
    if spread <= _CONSTANT * float(np.abs(array).max()):
        return np.zeros(len(array))
    return np.asarray((array - array.mean()) / spread)


def _check_recorded(names: Sequence[str], motion: Mapping[str, MotionFeatures]) -> None:
    missing = [name for name in names if name not in motion]
    if missing:
        raise ConfigError(
            f"{len(missing)} of {len(names)} pieces have no recorded performance, first "
            f"{missing[0]!r}: expected one of each piece, or none at all."
        )


def _ranked(names: Sequence[str], scores: FloatArray) -> dict[str, Difficulty]:
    # Sums round differently for equal pieces.
    scores = scores.round(9) + 0.0
    in_order = np.sort(scores)
    below = np.searchsorted(in_order, scores, side="left")
    up_to = np.searchsorted(in_order, scores, side="right")
    found = {
        name: Difficulty(
            score=float(scores[index]),
            rank=int(below[index]) + 1,
            percentile=100.0 * float(below[index] + 1 + up_to[index]) / 2 / len(names),
        )
        for index, name in enumerate(names)
    }
    return dict(sorted(found.items(), key=lambda item: (item[1].score, item[0])))
