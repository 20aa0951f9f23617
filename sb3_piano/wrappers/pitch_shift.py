"""Pieces shifted along the keyboard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from sb3_piano.music import MAX_PITCH, MIN_PITCH, Score
from sb3_piano.settings import Whole
from sb3_piano.wrappers.score_change import FixedOrRange, ScoreChange
from sb3_piano.wrappers.score_wrapper import possible_scores


class KeyShift(ScoreChange):
    """Shift each piece by a number of equal steps, fixed or drawn.

    Args:
        env: A piano environment, wrapped or not.
        name: Name of the argument that has the number of steps, for messages.
        steps: A whole number, or a pair of the lowest and the highest.
        semitones: Length of a step.
    """

    def __init__(self, env: gym.Env[Any, Any], name: str, steps: Any, *, semitones: int) -> None:
        super().__init__(env)
        self._steps = FixedOrRange.of(name, steps, Whole)
        self._semitones = semitones
        possible_scores(self)  # raises if a piece cannot be shifted

    def draw(self, score: Score, random: np.random.Generator) -> int:
        """Return the shift of this episode, in semitones."""
        steps = self._steps
        if steps.fixed:
            return steps.low * self._semitones
        down, up = _room(score)
        first, last = -(-down // self._semitones), up // self._semitones
        low, high = _clamp(steps.low, first, last), _clamp(steps.high, first, last)
        return int(random.integers(low, high, endpoint=True)) * self._semitones

    def extreme_values(self, score: Score) -> list[int]:
        """Return the lowest and the highest shift, in semitones."""
        lowest, highest = self._steps.low * self._semitones, self._steps.high * self._semitones
        if self._steps.fixed:
            return [lowest]
        # Not clamped to whole steps: part of the score may have room for one more of them.
        return [_clamp(lowest, *_room(score)), _clamp(highest, *_room(score))]

    def changed(self, score: Score, value: int) -> Score:
        """Return the score shifted by so many semitones."""
        return score.transpose(value)


class PitchShift(KeyShift, gym.utils.RecordConstructorArgs):
    """Shift each piece up or down, by whole semitones.

    ``PitchShift(env, 3)`` plays all pieces three semitones higher. ``PitchShift(env, [-2, 2])``
    draws one of the five shifts for each episode, all equally likely. Of a range only those shifts
    are drawn that keep all notes of the piece on the keyboard; if none does, the one that is
    nearest to the range.

    Args:
        env: A piano environment, wrapped or not.
        semitones: The shift, negative for lower; or a pair of the lowest and the highest to draw
            from, both included.

    Raises:
        ConfigError: If ``semitones`` is neither, or ``env`` is no piano.
        ScoreError: If a fixed shift takes a note off the keyboard, here for the environment's own
            pieces, at ``reset`` for others.
    """

    def __init__(self, env: gym.Env[Any, Any], semitones: int | Sequence[int]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self, semitones=semitones)
        super().__init__(env, "semitones", semitones, semitones=1)


def _room(score: Score) -> tuple[int, int]:
    """Return the lowest and the highest shift that keeps a piece on the keyboard, semitones."""
    lowest, highest = score.pitch_range
    return MIN_PITCH - lowest, MAX_PITCH - highest


def _clamp(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)
