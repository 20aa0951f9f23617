"""Assign notes to a pianist's hands where the file does not give them; take one hand's part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sb3_piano.arrays import BoolArray, FloatArray
from sb3_piano.exceptions import ScoreError
from sb3_piano.music.constants import FINGERS_PER_HAND
from sb3_piano.music.fingering.ergonomic import TOGETHER
from sb3_piano.music.fingering.hand_search import HandCosts, Part, lowest_left, search
from sb3_piano.music.hands import Hand
from sb3_piano.music.note import Note
from sb3_piano.music.score import Score

# Costs of giving notes to a hand. Widths and ways are in semitones.
_WIDTH = 0.1  # per semitone of a hand's chord, lowest to highest key
_COMFORTABLE, _WIDE = 12.0, 1.0  # width from which a semitone costs more, and how much
_HELD, _HELD_MOST = 0.3, 3.0  # per semitone and finger added by held keys; limited by a release
_FINGER = 5.0  # for each key beyond five that a hand strikes together
_ENTRY = 0.5  # for a hand's first strike
_WAY = 0.06  # per semitone that the middle of a hand moves
_REACH, _FAR = 9.0, 0.15  # way from which a semitone costs more, and how much
_CROSSING, _CROSSING_SIZE = 1.0, 0.2  # for keys beyond the other hand's last ones, and per semitone
_MEMORY = 1.0  # s after which a hand's last place matters 1/e as much for crossing
_CENTRE, _REGISTER = 60.0, 0.03  # per semitone of the right hand below this pitch, the left above
_SLOWEST, _FASTEST = 0.3, 2.0  # limits of the factor by which time weights the ways
_PACE = 0.25  # s since a hand's last strike at which that factor is 1

_PLACE, _EDGE, _STRUCK = range(3)
"""A hand's state: the middle of its last chord and its key nearest to the other hand, both as MIDI
pitches, and the time of that chord, s."""


def assign_hands(score: Score) -> Score:
    """Assign a hand to each note of a score.

    Known hands stay. A beam search over chords finds the others. The left hand takes the lower keys
    of a chord, so that hands never cross within it. Stretching, travelling and striking beyond the
    other hand have costs.
    """
    if all(note.hand is not None for note in score.notes):
        return score
    hands = search(score.notes, _Pianist())
    notes = [replace(note, hand=hand) for note, hand in zip(score.notes, hands, strict=True)]
    return replace(score, notes=tuple(notes))


def of_hand(score: Score, hand: Hand) -> Score:
    """Return the notes of a hand, including those of an unknown hand.

    Raises:
        ScoreError: If there are none; the message names the options of environments.
    """
    notes = tuple(
        note if note.hand == hand else replace(note, hand=hand)
        for note in score.notes
        if note.hand in (hand, None)
    )
    if not notes:
        raise ScoreError(
            f"{score.title!r} has no notes for the {hand} hand: expected a piece that it plays in, "
            "or other hands or hands_in_scene."
        )
    return score if notes == score.notes else replace(score, notes=notes)


class _Pianist(HandCosts):
    """Costs of a pianist's hands."""

    start = np.array([0.0, 0.0, -np.inf])

    def options(self, struck: Sequence[Note]) -> BoolArray:
        hands = np.array([note.hand or "" for note in struck])
        return np.unique(np.where(hands == "", lowest_left(struck), hands == "left"), axis=0)

    def place(self, note: Note) -> float:
        return note.pitch

    def cost_of(self, states: FloatArray, part: Part) -> tuple[FloatArray, FloatArray]:
        low, onset = part.low, part.chord.onset
        width = part.high - low
        strikes = _WIDTH * width + _WIDE * np.maximum(width - _COMFORTABLE, 0)
        strikes += _FINGER * np.maximum(part.count - FINGERS_PER_HAND, 0)
        added = np.maximum(part.whole, _COMFORTABLE) - np.maximum(width, _COMFORTABLE)
        fingers = np.maximum(part.count + part.held - FINGERS_PER_HAND, 0)
        holds = np.minimum(_HELD * added + _HELD * fingers, _HELD_MOST)
        middle = part.sign * (low + part.high) / 2
        keys = part.sign * np.array([note.pitch for note in part.chord.struck], dtype=float)
        wrong = np.maximum(part.sign * _CENTRE - keys, 0)
        cost = (
            (strikes + np.where(part.held, holds, 0.0))
            + _way(states[:, part.hand], middle, onset)
            + _crossing(states[:, 1 - part.hand], part.sign, low, onset)
            + _REGISTER * (part.takes * wrong).sum(axis=1)
        )
        return cost, np.stack([middle, part.sign * low, np.full(len(low), onset)], axis=-1)


def _way(states: FloatArray, middle: FloatArray, onset: float) -> FloatArray:
    way = np.abs(middle - states[:, _PLACE, None])
    cost = _WAY * way + _FAR * np.maximum(way - _REACH, 0)
    time = np.maximum(onset - states[:, _STRUCK, None], TOGETHER)
    speed = np.clip(np.sqrt(_PACE / time), _SLOWEST, _FASTEST)
    return np.where(np.isfinite(time), speed * cost, _ENTRY)


def _crossing(other: FloatArray, sign: float, low: FloatArray, onset: float) -> FloatArray:
    depth = sign * other[:, _EDGE, None] - low
    fresh = np.exp(-(onset - other[:, _STRUCK, None]) / _MEMORY)
    return np.where(depth >= 0, fresh * (_CROSSING + _CROSSING_SIZE * depth), 0.0)
